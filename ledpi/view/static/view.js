// The live page. It asks for the next picture once it has drawn the last, and for the state as soon as that has changed.
"use strict";

const KEPT_S = 300; // of the charts
const KEPT_REJECTED_MS = 800;
const LATE_MS = 250; // a picture that is older is told in red
const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

// ---- Asking the server

let token = sessionStorage.getItem("token") || "";
if (location.hash.startsWith("#token=")) {
  token = decodeURIComponent(location.hash.slice(7));
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname); // it is not left in the address bar
}

class Refused extends Error {}
class LoginNeeded extends Error {}

let lastAnswer = performance.now();

async function ask(path, method = "GET") {
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  const answer = await fetch(path, { method, headers, cache: "no-store", signal: AbortSignal.timeout(method === "POST" ? 130000 : 15000) });
  lastAnswer = performance.now();
  if (answer.status === 401) throw new LoginNeeded();
  if (!answer.ok) throw new Refused((await answer.json()).error);
  return answer;
}

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// For ever; what fails is tried again.
async function again(step) {
  for (;;) {
    try {
      await step();
    } catch (error) {
      if (error instanceof LoginNeeded) await login();
      else await pause(error instanceof Refused ? 1000 : 500);
    }
  }
}

let loggingIn = null;
function login() {
  loggingIn ??= new Promise((done) => {
    const wrong = token !== "";
    $("page").hidden = true;
    $("login").hidden = false;
    if (wrong) notice("That token is wrong.");
    $("token").focus();
    $("login").addEventListener("submit", (event) => {
      event.preventDefault();
      token = $("token").value.trim();
      sessionStorage.setItem("token", token);
      $("login").hidden = true;
      $("page").hidden = false;
      notice("");
      loggingIn = null;
      loadHistory();
      done();
    }, { once: true });
  });
  return loggingIn;
}

// ---- The server's clock (CLOCK_MONOTONIC), from the answers that were under way for the shortest time

let clock = { offset_ms: 0, under_way_ms: Infinity };
function see(told, asked_ms, got_ms) {
  const came = told.came_ns / 1e6, sent = told.sent_ns / 1e6;
  const underWay = got_ms - asked_ms - (sent - came);
  clock.under_way_ms += 0.01; // clocks drift: an old measurement is trusted less and less
  if (underWay <= clock.under_way_ms) clock = { offset_ms: (came - asked_ms + (sent - got_ms)) / 2, under_way_ms: underWay };
}
const ageOf = (exposed_ns) => performance.now() + clock.offset_ms - exposed_ns / 1e6;

// ---- Pictures

let frame = null; // what was told with the picture that is shown
let drawnTimes = [];

const kind = () => document.querySelector("input[name=kind]:checked").value;

async function nextPicture() {
  if (document.hidden) { // nothing is encoded for a page that nobody sees
    await new Promise((done) => document.addEventListener("visibilitychange", done, { once: true }));
    return;
  }
  const shown = kind(), asked = performance.now();
  const answer = await ask(`/api/frame?kind=${shown}&after=${frame && frame.kind === shown ? frame.number : -1}`);
  if (answer.status === 204) return;
  const data = await answer.arrayBuffer(), got = performance.now();
  const size = new DataView(data).getUint32(0);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
  const picture = await createImageBitmap(new Blob([new Uint8Array(data, 4 + size)], { type: "image/jpeg" }));
  if (shown !== kind()) return;
  see(told, asked, got);
  frame = { ...told, kind: shown };
  keepRejected();
  drawPicture(picture);
  drawOverlay();
  tellPicture();
  drawLight();
}

// The daemon searches the whole picture in every third frame only: what that has rejected stays for the two between.
let kept = { rejected: {}, why_not: [], until: 0 };
function keepRejected() {
  const now = performance.now(), searched = Object.keys(frame.rejected).some((key) => key.startsWith("find."));
  if (searched || now > kept.until || (frame.why_not || []).length > kept.why_not.length) {
    kept = { rejected: frame.rejected, why_not: frame.why_not || [], until: now + KEPT_REJECTED_MS };
  } else if (frame.kind === "whynot") frame.why_not = kept.why_not;
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

function tellPicture() {
  const age = ageOf(frame.exposed_ns), now = performance.now();
  drawnTimes = [...drawnTimes.filter((t) => now - t < 2000), now];
  $("age").textContent = `age ${age.toFixed(0)} ms`;
  $("age").classList.toggle("late", age > LATE_MS);
  $("age").dataset.ms = age.toFixed(1);
  $("rate").textContent = `${(drawnTimes.length / 2).toFixed(0)} pictures/s`;
  const bands = frame.bands_share ? `, bands ±${(100 * frame.bands_share).toFixed(1)} %` : "";
  $("seq").textContent = `frame ${frame.seq}${bands}`;
  const ids = frame.panels.map((panel) => panel.id).join(", ");
  $("picture").setAttribute("aria-label", ids ? `The camera's picture; panels ${ids}` : "The camera's picture; no panel");
}

// ---- What is drawn over them

function element(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}
const pointsOf = (corners) => corners.map((corner) => corner.join(",")).join(" ");

function drawOverlay() {
  const svg = $("overlay");
  svg.replaceChildren();
  const unit = frame.width / Math.max(svg.clientWidth, 1); // picture pixels of a CSS pixel
  const taken = frame.panels.map((panel) => boxOf(panel.corners_px));
  if (frame.kind === "whynot") frame.why_not.forEach((found) => drawRejected(svg, found));
  for (const panel of frame.panels) drawPanel(svg, panel, unit, taken);
  if (frame.kind === "whynot") frame.why_not.forEach((found, index) => labelRejected(svg, found, index + 1, unit, taken));
  $("whynot").hidden = frame.kind !== "whynot";
  if (frame.kind === "whynot") tellRejected();
}

function drawCells(svg, cells) {
  for (const cell of cells) {
    element(svg, "polygon", { class: `cell ${cell.white ? "white" : "black"}`, points: pointsOf(cell.corners_px) });
  }
}

function drawPanel(svg, panel, unit, taken) {
  if (frame.kind !== "bands") drawCells(svg, panel.cells);
  element(svg, "polygon", { class: "panel", points: pointsOf(panel.corners_px), "data-id": panel.id });
  if (panel.axes_px && frame.kind !== "bands") { // they would hide the bands
    const [from, ...tips] = panel.axes_px;
    tips.forEach((tip, axis) => element(svg, "line",
      { class: "xyz"[axis], x1: from[0], y1: from[1], x2: tip[0], y2: tip[1] }));
  }
  const place = panel.distance_m === null ? "" : ` · ${panel.distance_m.toFixed(2)} m`;
  label(svg, panel.corners_px, `ID ${panel.id}${place}`, "", 15 * unit, taken);
}

function drawRejected(svg, found) {
  drawCells(svg, found.cells);
  element(svg, "polygon", { class: "dropped", points: pointsOf(found.corners_px), "data-why": found.why });
}

function labelRejected(svg, found, number, unit, taken) {
  const words = found.mistake || found.means;
  const whole = `${number} · ${words.length > 48 ? `${words.slice(0, 46)}…` : words}`;
  if (!label(svg, found.corners_px, whole, "dropped-text", 12 * unit, taken)) {
    label(svg, found.corners_px, String(number), "dropped-text", 12 * unit, taken, true);
  }
}

function boxOf(corners) {
  const xs = corners.map((c) => c[0]), ys = corners.map((c) => c[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
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
  for (const y of [top - size / 2, bottom + height, ...(anyway ? [(top + bottom) / 2] : [])]) {
    const box = [x, y - height, x + width, y + size * 0.2];
    const free = !taken.some((t) => box[0] < t[2] && t[0] < box[2] && box[1] < t[3] && t[1] < box[3]);
    if (box[1] >= 0 && box[3] <= frame.height && (free || anyway)) {
      text.setAttribute("x", x);
      text.setAttribute("y", y);
      taken.push(box);
      return true;
    }
  }
  text.remove();
  return false;
}

let reasonsTold = "";
function tellRejected() {
  const list = $("reasons");
  const told = JSON.stringify(frame.why_not.map((found) => [found.why, found.mistake]));
  if (told === reasonsTold) return; // or who reads it with the keyboard is thrown out
  reasonsTold = told;
  list.replaceChildren(...frame.why_not.map((found, index) => {
    const item = document.createElement("li"), number = document.createElement("b"), words = document.createElement("span");
    item.tabIndex = 0;
    item.dataset.why = found.why;
    number.textContent = index + 1;
    if (found.mistake) words.append(span(found.mistake, "mistake"), ". ");
    words.append(found.means, ". ", found.helps ? `What helps, if it is a panel: ${found.helps}. ` : "");
    const key = document.createElement("code");
    key.textContent = found.why;
    words.append(key);
    item.append(number, words);
    const mark = (on) => $("overlay").querySelectorAll(".dropped")[index]?.classList.toggle("told", on);
    for (const event of ["focus", "mouseenter"]) item.addEventListener(event, () => mark(true));
    for (const event of ["blur", "mouseleave"]) item.addEventListener(event, () => mark(false));
    return item;
  }));
  if (!frame.why_not.length) list.append(span("Nothing four-sided was dropped.", "quiet"));
}

function span(text, cls) {
  const made = document.createElement("span");
  made.textContent = text;
  made.className = cls;
  return made;
}

// ---- Focus and light

let best = 0, bestOf = "";
function drawLight() {
  if (frame.focus_of !== bestOf) [best, bestOf] = [0, frame.focus_of]; // scores of different things are not compared
  best = Math.max(best, frame.focus);
  const share = best ? Math.round((100 * frame.focus) / best) : 0;
  $("focus").textContent = frame.focus.toFixed(0);
  $("best").textContent = best.toFixed(0);
  $("focus-of").textContent = bestOf;
  $("focus-meter").firstElementChild.style.width = `${share}%`;
  $("focus-meter").setAttribute("aria-valuenow", share);
  $("exposure").textContent = frame.exposure_us == null ? "–" : `${(frame.exposure_us / 1000).toFixed(2)} ms`;
  $("gain").textContent = frame.analogue_gain == null ? "unknown" : `× ${frame.analogue_gain.toFixed(1)}`;
  $("saturated").textContent = `${(100 * frame.saturated_share).toFixed(2)} %`;
  drawHistogram();
}

function canvasOf(id) {
  const canvas = typeof id === "string" ? $(id) : id, scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, width, height, scale };
}
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function drawHistogram() {
  const { context, width, height } = canvasOf("histogram"), bins = frame.histogram;
  const most = Math.log1p(Math.max(...bins, 1)), step = width / bins.length;
  bins.forEach((count, index) => {
    const tall = (height * Math.log1p(count)) / most; // logarithmic: a panel is few pixels of many
    context.fillStyle = colour(index === bins.length - 1 ? "bad" : "accent");
    context.fillRect(index * step, height - tall, Math.max(step - 1, 1), tall);
  });
  $("histogram").setAttribute("aria-label", `Histogram of brightness; ${$("saturated").textContent} of the pixels are full`);
}

// ---- State

let state = null, version = -1, lastLink = "", starts = 0;

async function nextState() {
  const answer = await ask(`/api/state?after=${version}`);
  state = await answer.json();
  version = state.version;
  tellLink();
  tellPanels();
  tellHealth();
  drawMap();
  tellButtons();
  await pause(200); // five times a second is enough to read
}

function notice(text, good = false) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
  $("notice").classList.toggle("good", good);
}

let goodUntil = 0;
function tellLink() {
  const { link, health } = state, up = link.state === "up";
  const says = up ? (health ? health.state.replaceAll("_", " ") : "connected") : link.state === "down" ? "no daemon" : "silent";
  $("state").textContent = says;
  $("state").className = `pill ${!up ? "down" : health && health.state !== "running" ? "warn" : "up"}`;
  $("fix").textContent = up && health && health.no_fix && health.no_fix !== "none" ? `no fix: ${health.no_fix.replaceAll("_", " ")}` : "";
  if (!up) {
    notice(`The picture stands still: ${link.says}.`);
    $("blank").hidden = false;
    $("blank").textContent = link.state === "down" ? "no daemon" : "the daemon is silent";
  } else if (lastLink && lastLink !== "up") {
    notice(link.starts > starts && starts ? "The daemon was started anew; this page follows it again." : "The daemon is back.", true);
    goodUntil = performance.now() + 6000;
    [best, reasonsTold] = [0, ""];
    loadHistory();
  } else if (performance.now() > goodUntil && $("notice").textContent) notice("");
  if (up) starts = link.starts;
  lastLink = link.state;
  const daemon = state.daemon;
  $("version").textContent = daemon ? `version ${daemon.version}, ${daemon.camera.source}, ${daemon.camera.width} × ${daemon.camera.height}` : "";
}

function cells(row, texts) {
  texts.forEach((text, index) => {
    const cell = row.cells[index] || row.insertCell();
    if (cell.textContent !== text) cell.textContent = text;
  });
}

function tellPanels() {
  const body = $("panels").tBodies[0], rows = state.panels;
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((panel, index) => {
    const row = body.rows[index] || body.insertRow();
    row.dataset.id = panel.id;
    row.classList.toggle("old", panel.age_ms > 500);
    cells(row, [
      String(panel.id),
      panel.distance_m === null ? "–" : `${panel.distance_m.toFixed(3)} m`,
      panel.yaw_deg === null ? "–" : `${panel.yaw_deg.toFixed(1)}°${panel.ambiguous ? "?" : ""}`,
      panel.age_ms < 2000 ? `${panel.age_ms.toFixed(0)} ms` : `${(panel.age_ms / 1000).toFixed(0)} s`,
      `${panel.rate_hz.toFixed(0)}/s`,
      panel.margin.toFixed(0),
    ]);
  });
  $("panels").hidden = !rows.length;
  $("no-panels").hidden = rows.length > 0;
  const counts = Object.entries(kept.rejected);
  $("rejected").textContent = counts.length ? `Rejected in this picture: ${counts.map(([key, n]) => `${key} ${n}`).join(", ")}` : "";
}

// ---- The map: x to the right, y up, in metres

let track = [];
function drawMap() {
  const svg = $("map"), panels = state.map || [], robot = state.robot;
  svg.toggleAttribute("hidden", !panels.length);
  if (!panels.length) {
    $("place").textContent = state.daemon ? "The daemon has no map (key map)." : "";
    return;
  }
  const last = track[track.length - 1];
  if (robot && (!last || Math.hypot(last[0] - robot.position_m[0], last[1] - robot.position_m[1]) > 0.01)) {
    track = [...track.slice(-300), robot.position_m];
  }
  const at = [...panels.flatMap((panel) => panel.corners_m), ...track, ...(robot ? [robot.position_m] : [])];
  const [left, low, right, high] = boxOf(at), rim = Math.max(0.4, 0.12 * Math.max(right - left, high - low));
  const width = Math.max(right - left + 2 * rim, 1), height = Math.max(high - low + 2 * rim, 1);
  const [x0, y0] = [(left + right - width) / 2, -(low + high + height) / 2];
  svg.setAttribute("viewBox", `${x0} ${y0} ${width} ${height}`);
  svg.replaceChildren();
  const unit = Math.max(width / Math.max(svg.clientWidth, 1), height / Math.max(svg.clientHeight, 1));
  drawGrid(svg, [x0, y0, width, height], unit);
  for (const panel of panels) drawMapPanel(svg, panel, unit);
  if (track.length > 1) element(svg, "polyline", { class: "track", points: track.map(([x, y]) => `${x},${-y}`).join(" ") });
  if (robot) drawRobot(svg, robot, unit);
  tellPlace(robot);
}

function drawGrid(svg, [x0, y0, width, height], unit) {
  const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((metres) => metres / unit > 45) || 100;
  for (let x = Math.ceil(x0 / step) * step; x < x0 + width; x += step) element(svg, "line", { class: "grid", x1: x, x2: x, y1: y0, y2: y0 + height });
  for (let y = Math.ceil(y0 / step) * step; y < y0 + height; y += step) element(svg, "line", { class: "grid", x1: x0, x2: x0 + width, y1: y, y2: y });
  element(svg, "text", { x: x0 + 6 * unit, y: y0 + height - 6 * unit, "font-size": 11 * unit }, `a square is ${step} m`);
}

function drawMapPanel(svg, panel, unit) {
  const corners = panel.corners_m.map(([x, y]) => [x, -y]), [left, top, right, bottom] = boxOf(corners);
  const x = (left + right) / 2, y = (top + bottom) / 2, [fx, fy] = panel.facing;
  element(svg, "polygon", { class: "wall", points: pointsOf(corners), "data-id": panel.id });
  element(svg, "line", { class: "facing", x1: x, y1: y, x2: x + 14 * unit * fx, y2: y - 14 * unit * fy });
  element(svg, "text", { x: x - 18 * unit * fx, y: y + 18 * unit * fy + 4 * unit, "font-size": 12 * unit, "text-anchor": "middle" }, panel.id);
}

function drawRobot(svg, robot, unit) {
  const [x, y] = [robot.position_m[0], -robot.position_m[1]], turn = (-180 * robot.heading_rad) / Math.PI;
  if (robot.ellipse) {
    const angle = (-180 * robot.ellipse.angle_rad) / Math.PI;
    element(svg, "ellipse", { class: "error", cx: x, cy: y, rx: robot.ellipse.long_m, ry: robot.ellipse.short_m, transform: `rotate(${angle} ${x} ${y})` });
  }
  const s = 9 * unit;
  element(svg, "polygon", {
    class: `robot${robot.age_ms > 500 ? " old" : ""}`, points: `${x + 1.4 * s},${y} ${x - s},${y + 0.9 * s} ${x - 0.5 * s},${y} ${x - s},${y - 0.9 * s}`,
    transform: `rotate(${turn} ${x} ${y})`, "data-x": robot.position_m[0], "data-y": robot.position_m[1], "data-seq": robot.seq,
  });
}

function tellPlace(robot) {
  if (!robot) {
    $("place").textContent = "No fix in the last frame.";
    return;
  }
  const [x, y] = robot.position_m, error = robot.ellipse ? `, error ellipse of 2 deviations ${(100 * robot.ellipse.long_m).toFixed(1)} × ${(100 * robot.ellipse.short_m).toFixed(1)} cm` : "";
  const heading = ((180 * robot.heading_rad) / Math.PI).toFixed(1);
  $("place").textContent = `Robot at x ${x.toFixed(3)}, y ${y.toFixed(3)} m, heading ${heading}°${error}; by ${robot.panels_used.length === 1 ? "panel" : "panels"} ${robot.panels_used.join(", ")}`;
}

// ---- The last minutes

let past = [];
const CHARTS = [
  { name: "Latency", unit: "ms", of: [(h) => h.latency_ms?.median, (h) => h.latency_ms?.worst] },
  { name: "Frames decoded", unit: "/s", of: [(h) => h.decoded_per_s ?? h.frames_per_s] },
  { name: "Frames dropped", unit: "/s", of: [(h, before) => before && h.at_ns > before.at_ns && Math.max(0, (1e9 * (h.dropped_frames - before.dropped_frames)) / (h.at_ns - before.at_ns))] },
  { name: "Temperature", unit: "°C", of: [(h) => h.temperature_c] },
];
for (const chart of CHARTS) {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  chart.value = document.createElement("b");
  chart.canvas = document.createElement("canvas");
  chart.canvas.setAttribute("role", "img");
  caption.append(chart.name, chart.value);
  figure.append(caption, chart.canvas);
  $("charts").append(figure);
}

async function loadHistory() {
  try {
    const told = await (await ask("/api/history")).json();
    past = told.health;
    track = told.track;
  } catch { /* it is asked again after the next interruption; until then what comes is kept here */ }
}

let healthTold = "";
function tellHealth() {
  const health = state.health;
  tellFaults(health ? health.faults || [] : []);
  tellChecks(state.checks);
  if (!health || JSON.stringify(health) === healthTold) return;
  healthTold = JSON.stringify(health);
  past = [...past, { ...health, at_ns: state.now_ns }].filter((h) => state.now_ns - h.at_ns < KEPT_S * 1e9);
  CHARTS.forEach(drawChart);
}

function drawChart(chart) {
  const series = chart.of.map((of) => past.map((h, index) => [h.at_ns, of(h, past[index - 1])]).filter(([, v]) => typeof v === "number"));
  const latest = series[0][series[0].length - 1]?.[1];
  const text = latest === undefined ? "not known" : `${latest.toFixed(latest < 10 ? 1 : 0)} ${chart.unit}`;
  chart.value.textContent = text;
  const { context, width, height, scale } = canvasOf(chart.canvas), most = Math.max(...series.flat().map(([, v]) => v), 1e-9) * 1.1;
  chart.canvas.setAttribute("aria-label", `${chart.name}: now ${text}, at most ${(most / 1.1).toFixed(1)} ${chart.unit} in the last minutes`);
  if (latest === undefined) return;
  series.forEach((points, index) => {
    context.beginPath();
    context.strokeStyle = colour(index ? "warn" : "accent");
    context.lineWidth = 1.5 * scale;
    for (const [at, value] of points) context.lineTo(width * (1 - (state.now_ns - at) / (KEPT_S * 1e9)), height * (1 - value / most));
    context.stroke();
  });
  context.fillStyle = colour("quiet");
  context.font = `${10 * scale}px system-ui, sans-serif`;
  context.fillText((most / 1.1).toFixed(most < 10 ? 1 : 0), 4 * scale, 11 * scale);
}

let faultsTold = "";
function tellFaults(faults) {
  const told = JSON.stringify(faults);
  $("no-faults").hidden = faults.length > 0;
  if (told === faultsTold) return;
  faultsTold = told;
  $("faults").replaceChildren(...[...faults].reverse().map((fault) => {
    const item = document.createElement("li"), when = document.createElement("time");
    const ago_s = (state.now_ns - fault.at_ns) / 1e9, at = new Date(Date.now() - 1000 * ago_s);
    when.textContent = at.toLocaleTimeString();
    item.append(when, fault.text);
    return item;
  }));
}

let checksTold = "";
function tellChecks(checks) {
  const told = JSON.stringify(checks);
  if (told === checksTold) return;
  checksTold = told;
  $("checks").replaceChildren(...checks.map(({ name, state: how, said, remedy }) => {
    const item = document.createElement("li"), mark = document.createElement("b"), words = document.createElement("span");
    item.className = how;
    mark.textContent = { ok: "✓", bad: "✗", unknown: "–" }[how];
    mark.setAttribute("aria-label", { ok: "good", bad: "wrong", unknown: "not there" }[how]);
    words.textContent = `${name}: ${said}${remedy ? `. What to do: ${remedy}` : ""}`;
    item.append(mark, words);
    return item;
  }));
}

// ---- Buttons

function tellButtons() {
  const recording = state.recording;
  const up = state.link.state === "up", may = (state.daemon && state.daemon.may) || [];
  let reason = "";
  if (!up) reason = "Saving and recording need a running daemon.";
  else if (!token) reason = "Saving and recording need the token: open the address that ledpi view has printed.";
  else if (!may.length) reason = "The daemon permits this page no saving: ledpi view must run as the daemon's user, as root, or in group ledpi.";
  $("save").disabled = !!reason || !may.includes("save");
  $("record").disabled = !!reason || !may.includes("record");
  if (!reason && !may.includes("save")) reason = "There are no last seconds to save: rewind.seconds is 0.";
  $("why-greyed").textContent = reason;
  $("keep").disabled = !frame;
  $("record").textContent = recording ? "Stop the recording" : "Start a recording";
  $("record").classList.toggle("on", recording);
}

async function change(path, done) {
  $("done").textContent = "…";
  try {
    const told = await (await ask(path, "POST")).json();
    $("done").textContent = done(told);
  } catch (error) {
    if (error instanceof LoginNeeded) login();
    $("done").textContent = error instanceof LoginNeeded ? "The token is wrong." : `Not done: ${error.message}`;
  }
}

$("save").addEventListener("click", () => change("/api/save", (told) => `Saved as ${told.path} on the daemon's machine.`));
$("record").addEventListener("click", async () => {
  const wanted = !state.recording;
  await change(wanted ? "/api/record" : "/api/record_stop", (told) =>
    wanted ? `Recording${told.path ? ` into ${told.path}` : ""}.` : `Recorded${told.path ? ` as ${told.path}` : ""}.`);
});
async function download(path, name) {
  const link = document.createElement("a");
  try {
    link.href = URL.createObjectURL(await (await ask(path)).blob());
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    $("done").textContent = "Saved by the browser.";
  } catch (error) {
    $("done").textContent = `Not done: ${error.message}`;
  }
}
$("keep").addEventListener("click", () => download("/api/frame.png", `ledpi-frame-${frame.seq}.png`));
$("forget").addEventListener("click", () => { best = 0; });
for (const input of document.querySelectorAll("input[name=kind]")) input.addEventListener("change", () => { reasonsTold = ""; });

$("config").addEventListener("toggle", async () => {
  if (!$("config").open) return;
  try {
    const keys = await (await ask("/api/config")).json();
    $("keys").replaceChildren(...keys.map(({ key, value, from }) => {
      const row = document.createElement("tr");
      cells(row, [key, value === null ? "null" : typeof value === "object" ? JSON.stringify(value) : String(value), from]);
      return row;
    }));
  } catch (error) {
    $("config-says").textContent = `It cannot be shown: ${error.message}`;
  }
});

// ---- The lens

async function nextBoard() {
  if (!$("board").open) {
    await new Promise((done) => $("board").addEventListener("toggle", done, { once: true }));
  }
  tellBoard(await (await ask("/api/board")).json());
  await pause(400);
}

function tellBoard(told) {
  const runs = told !== null && told.runs;
  $("board-start").disabled = !token || runs;
  $("board-stop").hidden = !runs;
  if (told === null) {
    $("board-says").textContent = token ? "" : "This needs the token: open the address that ledpi view has printed.";
    return;
  }
  $("board-says").textContent = told.says;
  const rms = told.rms_px === null ? "" : `; the lens explains them to ${told.rms_px.toFixed(3)} px (rms)`;
  $("board-found").textContent = `${told.views} views, ${told.enough} or more are wanted${rms}. ${told.lens_says}`;
  $("lens").hidden = told.rms_px === null;
  $("coverage").hidden = false;
  $("coverage").setAttribute("aria-label", `Corners in the parts of the picture, row by row: ${told.coverage.map((row) => row.join(" ")).join("; ")}`);
  $("coverage").replaceChildren(...told.coverage.flat().map((count) => span(String(count), count ? "seen" : "")));
}

$("board-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const asked = new URLSearchParams({ kind: $("board-kind").value, cols: $("board-cols").value, rows: $("board-rows").value });
  try {
    tellBoard(await (await ask(`/api/board/start?${asked}`, "POST")).json());
  } catch (error) {
    $("board-says").textContent = `Not done: ${error.message}`;
  }
});
$("board-stop").addEventListener("click", () => ask("/api/board/stop", "POST").then((answer) => answer.json()).then(tellBoard, () => {}));
$("lens").addEventListener("click", () => download("/api/camera.yaml", "camera.yaml"));

// ---- Begin

setInterval(() => { // ledpi view itself may have ended
  if (performance.now() - lastAnswer < 5000 || document.hidden || loggingIn) return;
  notice("ledpi view does not answer; this page tries again and again.");
  $("state").textContent = "no answer";
  $("state").className = "pill down";
  lastLink = "down";
}, 1000);
loadHistory().then(() => {
  again(nextState);
  again(nextPicture);
  again(nextBoard);
});
