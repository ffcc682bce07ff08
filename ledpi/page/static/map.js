// The map from above: x to the right, y up, in metres.

import { $ } from "./server.js";
import { boxOf, element, number, pointsOf } from "./drawing.js";

const STEPS_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
const KEPT = 300; // places of the track

let track = [];
export function setTrack(places) { track = places; }

export function drawMap({ map, robot, daemon }) {
  const svg = $("map"), panels = map || [];
  svg.toggleAttribute("hidden", !panels.length);
  if (!panels.length) {
    $("place").textContent = daemon ? "The daemon has no map: panel positions only, no robot position. ledpi calibrate map makes a map." : "";
    return;
  }
  const last = track[track.length - 1];
  if (robot && (!last || Math.hypot(last[0] - robot.position_m[0], last[1] - robot.position_m[1]) > 0.01)) {
    track = [...track.slice(-KEPT), robot.position_m];
  }
  const at = [...panels.flatMap((panel) => panel.corners_m), ...track, ...(robot ? [robot.position_m] : [])];
  const [left, low, right, high] = boxOf(at), rim = Math.max(0.4, 0.12 * Math.max(right - left, high - low));
  const width = Math.max(right - left + 2 * rim, 1), height = Math.max(high - low + 2 * rim, 1);
  const [x0, y0] = [(left + right - width) / 2, -(low + high + height) / 2];
  svg.setAttribute("viewBox", `${x0} ${y0} ${width} ${height}`);
  svg.replaceChildren();
  const unit = Math.max(width / Math.max(svg.clientWidth, 1), height / Math.max(svg.clientHeight, 1));
  drawGrid(svg, [x0, y0, width, height], unit);
  for (const panel of panels) drawPanel(svg, panel, unit);
  if (track.length > 1) element(svg, "polyline", { class: "track", points: track.map(([x, y]) => `${x},${-y}`).join(" ") });
  if (robot) drawRobot(svg, robot, unit);
  tellPlace(robot);
}

// A bar says how large its squares are.
function drawGrid(svg, [x0, y0, width, height], unit) {
  const step = STEPS_M.find((metres) => metres / unit > 45) || STEPS_M[STEPS_M.length - 1];
  for (let x = Math.ceil(x0 / step) * step; x < x0 + width; x += step) element(svg, "line", { class: "grid", x1: x, x2: x, y1: y0, y2: y0 + height });
  for (let y = Math.ceil(y0 / step) * step; y < y0 + height; y += step) element(svg, "line", { class: "grid", x1: x0, x2: x0 + width, y1: y, y2: y });
  const x = x0 + 8 * unit, y = y0 + height - 9 * unit, tick = 4 * unit;
  element(svg, "polyline", { class: "scale", points: pointsOf([[x, y - tick], [x, y], [x + step, y], [x + step, y - tick]]) });
  element(svg, "text", { x: x + step / 2, y: y - tick, "font-size": 11 * unit, "text-anchor": "middle" }, `${step} m`);
}

function drawPanel(svg, panel, unit) {
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
    $("place").textContent = "The last frames do not say where the robot is.";
    return;
  }
  const [x, y] = robot.position_m, heading = number((180 * robot.heading_rad) / Math.PI, 1);
  const error = robot.ellipse ? ` Error ellipse (2 standard deviations): ± ${length(robot.ellipse.long_m)} by ± ${length(robot.ellipse.short_m)}.` : "";
  const used = `${robot.panels_used.length === 1 ? "panel" : "panels"} ${robot.panels_used.join(", ")}`;
  $("place").textContent = `Robot at x ${number(x, 3)} m, y ${number(y, 3)} m, heading ${heading}°, by ${used}.${error}`;
}

const length = (metres) => metres < 0.01 ? `${(1000 * metres).toFixed(1)} mm` : metres < 1 ? `${(100 * metres).toFixed(1)} cm` : `${metres.toFixed(2)} m`;
