// The last minutes, the checks, and the daemon's last faults.

import { $, ask } from "./server.js";
import { canvasOf, colour, html, keepList, setText } from "./drawing.js";
import { setTrack } from "./map.js";

const KEPT_S = 300; // of the charts
const droppedRate = (h, before) => before && h.at_ns > before.at_ns && Math.max(0, (1e9 * (h.dropped_frames - before.dropped_frames)) / (h.at_ns - before.at_ns));
const CHARTS = [
  { name: "Latency", unit: "ms", says: "frame's last row to poses: median, and worst in orange", of: [(h) => h.latency_ms?.median, (h) => h.latency_ms?.worst] },
  { name: "Decoded", unit: "/s", says: "frames decoded a second", of: [(h) => h.decoded_per_s ?? h.frames_per_s] },
  { name: "Dropped", unit: "/s", says: "frames a second that came too soon after one another", of: [droppedRate] },
  { name: "Temperature", unit: "°C", says: "of the processor", of: [(h) => h.temperature_c] },
];
for (const chart of CHARTS) {
  chart.value = html("b");
  chart.canvas = html("canvas");
  chart.canvas.setAttribute("role", "img");
  const figure = html("figure", "", html("figcaption", "", html("span", "", chart.name), chart.value), chart.canvas);
  figure.title = chart.says;
  $("charts").append(figure);
}

let past = [];
export async function loadHistory() {
  try {
    const told = await (await ask("api/history")).json();
    past = told.health;
    setTrack(told.track);
  } catch { /* it is asked again after the next interruption; until then what comes is kept here */ }
}

let healthTold = "";
export function tellHealth({ health, checks, now_ns }) {
  tellFaults(health ? health.faults || [] : [], now_ns);
  keepList($("checks"), checks, () => html("li", "", html("b"), html("span")), tellCheck);
  if (!health || JSON.stringify(health) === healthTold) return;
  healthTold = JSON.stringify(health);
  past = [...past, { ...health, at_ns: now_ns }].filter((h) => now_ns - h.at_ns < KEPT_S * 1e9);
  CHARTS.forEach((chart) => drawChart(chart, now_ns));
}

function drawChart(chart, now_ns) {
  const series = chart.of.map((of) => past.map((h, index) => [h.at_ns, of(h, past[index - 1])]).filter(([, v]) => typeof v === "number"));
  const latest = series[0][series[0].length - 1]?.[1];
  const text = latest === undefined ? "–" : `${latest.toFixed(latest < 10 ? 1 : 0)} ${chart.unit}`;
  chart.value.textContent = text;
  const { context, width, height, scale } = canvasOf(chart.canvas), most = Math.max(...series.flat().map(([, v]) => v), 1e-9) * 1.1;
  const highest = (most / 1.1).toFixed(most < 10 ? 1 : 0);
  chart.canvas.setAttribute("aria-label", `${chart.name}, ${chart.says}: now ${text}, at most ${highest} in the last minutes`);
  if (latest === undefined) return;
  series.forEach((points, index) => {
    context.beginPath();
    context.strokeStyle = colour(index ? "warn" : "accent");
    context.lineWidth = 1.5 * scale;
    for (const [at, value] of points) context.lineTo(width * (1 - (now_ns - at) / (KEPT_S * 1e9)), height * (1 - value / most));
    context.stroke();
  });
  context.fillStyle = colour("quiet");
  context.font = `${11 * scale}px system-ui, sans-serif`;
  context.fillText(`max ${highest}`, 4 * scale, 12 * scale);
}

let faultsTold = "";
function tellFaults(faults, now_ns) {
  const told = JSON.stringify(faults);
  $("no-faults").hidden = faults.length > 0;
  if (told === faultsTold) return;
  faultsTold = told;
  $("faults").replaceChildren(...[...faults].reverse().map((fault) => {
    const at = new Date(Date.now() - (now_ns - fault.at_ns) / 1e6);
    return html("li", "", html("time", "", at.toLocaleTimeString()), fault.text);
  }));
}

function tellCheck(item, { name, state: how, said, remedy }) {
  item.className = how;
  const mark = item.firstElementChild;
  setText(mark, { ok: "✓", bad: "✗", unknown: "–" }[how]);
  mark.setAttribute("aria-label", { ok: "good", bad: "wrong", unknown: "not there" }[how]);
  setText(item.lastElementChild, `${name}: ${said}${remedy ? `. What to do: ${remedy}` : ""}`);
}
