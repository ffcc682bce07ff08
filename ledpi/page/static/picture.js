// The picture, what is drawn over it, and its age. The next one is asked for once the last one is drawn.

import { $, ask, see, ageOf } from "./server.js";
import { boxOf, element, html, number, pointsOf } from "./drawing.js";
import { drawLight } from "./light.js";
import { tellWhyNot } from "./why_not.js";

const LATE_MS = 250; // a picture that is older is told in red
const STANDS_MS = 1000; // that a picture is old, when the next one is late
const RATE_MS = 2000; // that pictures are counted over
const LONGEST_LABEL = 48; // letters

let frame = null; // what was told with the picture that is shown
let drawnTimes = [];
export const shownFrame = () => frame;

const kind = () => document.querySelector("input[name=kind]:checked").value;
export function choose(value) {
  document.querySelector(`input[name=kind][value=${value}]`).click();
}

export async function nextPicture() {
  if (document.hidden) { // nothing is encoded for a page that nobody sees
    await new Promise((done) => document.addEventListener("visibilitychange", done, { once: true }));
    return;
  }
  const shown = kind(), asked = performance.now();
  const answer = await ask(`api/frame?kind=${shown}&after=${frame && frame.kind === shown ? frame.number : -1}`);
  if (answer.status === 204) return;
  const data = await answer.arrayBuffer(), got = performance.now();
  const size = new DataView(data).getUint32(0);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
  const picture = await createImageBitmap(new Blob([new Uint8Array(data, 4 + size)], { type: "image/jpeg" }));
  if (shown !== kind()) return;
  see(told, asked, got);
  frame = { ...told, kind: shown };
  drawPicture(picture);
  drawOverlay();
  tellPicture();
  tellWhyNot(frame);
  drawLight(frame);
}

function drawPicture(picture) {
  const canvas = $("picture");
  if (canvas.width !== frame.width || canvas.height !== frame.height) {
    canvas.width = frame.width;
    canvas.height = frame.height;
    $("overlay").setAttribute("viewBox", `-0.5 -0.5 ${frame.width} ${frame.height}`);
  }
  canvas.getContext("2d").drawImage(picture, 0, 0, frame.width, frame.height);
  picture.close();
  $("blank").hidden = true;
  $("figure").dataset.seq = frame.seq;
}

function tellAge() {
  const age = ageOf(frame.exposed_ns), now = performance.now();
  drawnTimes = drawnTimes.filter((t) => now - t < RATE_MS);
  $("age").textContent = age < 2000 ? `age ${age.toFixed(0)} ms` : `age ${(age / 1000).toFixed(0)} s`;
  $("age").classList.toggle("late", age > LATE_MS);
  $("age").dataset.ms = age.toFixed(1);
  $("rate").textContent = `${((1000 * drawnTimes.length) / RATE_MS).toFixed(0)} pictures/s`;
}

setInterval(() => { // a picture that stands still gets older
  if (frame && ageOf(frame.exposed_ns) > STANDS_MS) tellAge();
}, 500);

function tellPicture() {
  drawnTimes.push(performance.now());
  tellAge();
  const bands = frame.bands_share ? `, bands ±${(100 * frame.bands_share).toFixed(1)} %` : "";
  $("seq").textContent = `frame ${frame.seq}${bands}`;
  const ids = frame.panels.map((panel) => panel.id).join(", ");
  $("picture").setAttribute("aria-label", ids ? `The camera's picture; panels ${ids}` : "The camera's picture; no panel");
  $("picture").dataset.kind = frame.kind;
}

// What the colours of cells stand for: the bit of the codeword, and how it blinks.
export function tellKey(panels) {
  const classes = panels.phase === "antiphase"
    ? [["black", "0"], ["white", `1, half a cycle later (${panels.black_hz} Hz)`]]
    : [["black", `0: ${panels.black_hz} Hz`], ["white", `1: ${panels.white_hz} Hz`]];
  const told = classes.map(([, text]) => text).join();
  if ($("key").dataset.told === told) return;
  $("key").dataset.told = told;
  $("key").replaceChildren("cells ", ...classes.flatMap(([cls, text]) => [html("i", cls), `${text} `]));
}

// ---- Over the picture

function drawOverlay() {
  const svg = $("overlay");
  svg.replaceChildren();
  const unit = frame.width / Math.max(svg.clientWidth, 1); // picture pixels of a CSS pixel
  const why = frame.kind === "whynot" ? frame.why_not : [];
  why.forEach((found) => drawDropped(svg, found));
  for (const panel of frame.panels) drawPanel(svg, panel);
  const taken = [...frame.panels, ...why.filter(isNumbered)].map((one) => boxOf(one.corners_px));
  for (const panel of frame.panels) labelPanel(svg, panel, 15 * unit, taken);
  why.filter(isNumbered).forEach((found, index) => labelDropped(svg, found, index + 1, 13 * unit, taken));
}

export const isNumbered = (found) => found.kind !== "shape";

function drawCells(svg, cells) {
  for (const cell of cells) {
    element(svg, "polygon", { class: `cell ${cell.white ? "white" : "black"}`, points: pointsOf(cell.corners_px) });
  }
}

function drawPanel(svg, panel) {
  if (frame.kind !== "bands") drawCells(svg, panel.cells);
  element(svg, "polygon", { class: "panel", points: pointsOf(panel.corners_px), "data-id": panel.id });
  if (panel.axes_px && frame.kind !== "bands") { // they would hide the bands
    const [from, ...tips] = panel.axes_px;
    tips.forEach((tip, axis) => element(svg, "line",
      { class: "xyz"[axis], x1: from[0], y1: from[1], x2: tip[0], y2: tip[1] }));
  }
}

function drawDropped(svg, found) {
  if (isNumbered(found)) drawCells(svg, found.cells);
  element(svg, "polygon", { class: `dropped ${found.kind}`, points: pointsOf(found.corners_px), "data-why": found.why });
}

function labelPanel(svg, panel, size, taken) {
  const id = `ID ${panel.id}`, place = panel.distance_m === null ? "" : ` · ${number(panel.distance_m, 2)} m`;
  if (!label(svg, panel.corners_px, id + place, "", size, taken)) label(svg, panel.corners_px, id, "", size, taken, true);
}

function labelDropped(svg, found, index, size, taken) {
  const words = found.says.length > LONGEST_LABEL ? `${found.says.slice(0, LONGEST_LABEL - 2)}…` : found.says;
  if (!label(svg, found.corners_px, `${index} · ${words}`, "dropped-text", size, taken)) {
    label(svg, found.corners_px, String(index), "dropped-text", size, taken, true);
  }
}

// Above or below a quad, where nothing else is; returns whether there was room. `anyway`: inside it, if there was none.
function label(svg, corners, words, cls, size, taken, anyway = false) {
  const [left, top, right, bottom] = boxOf(corners);
  const text = element(svg, "text", { class: cls, "font-size": size }, words);
  const width = text.getComputedTextLength(), height = size * 1.15;
  const x = Math.min(Math.max((left + right - width) / 2, size / 3), Math.max(frame.width - width - size / 3, 0));
  if (width > frame.width && !anyway) { // a phone's picture is narrow
    text.remove();
    return false;
  }
  const inside = (top + bottom + height) / 2;
  for (const y of [top - size / 2, bottom + height + size / 4, ...(anyway ? [inside] : [])]) {
    const box = [x, y - height, x + width, y + size * 0.2];
    const free = !taken.some((t) => box[0] < t[2] && t[0] < box[2] && box[1] < t[3] && t[1] < box[3]);
    if ((box[1] >= 0 && box[3] <= frame.height && free) || y === inside) {
      text.setAttribute("x", x);
      text.setAttribute("y", y);
      taken.push(box);
      return true;
    }
  }
  text.remove();
  return false;
}
