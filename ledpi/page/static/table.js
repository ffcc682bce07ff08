// The panels, and how the daemon is: in the head line, and in a notice where it is gone.

import { $, notice } from "./server.js";
import { cells, number } from "./drawing.js";

const GOOD_MS = 6000; // that a good notice stays

let lastLink = "", starts = 0, goodUntil = 0;
export function serverIsGone() { lastLink = "down"; }

// Returns whether the daemon is back.
export function tellLink({ link, health, daemon, panels, no_fix_says }) {
  const up = link.state === "up";
  const says = up ? (health ? health.state.replaceAll("_", " ") : "connected") : link.state === "down" ? "no daemon" : "silent";
  $("state").textContent = says;
  $("state").className = `pill ${!up ? "down" : health && health.state !== "running" ? "warn" : "up"}`;
  $("fix").textContent = up && no_fix_says ? `no position on the map: ${no_fix_says}` : "";
  const back = up && lastLink !== "" && lastLink !== "up";
  if (!up) {
    notice(`The picture stands still: ${link.says}.`);
    $("blank").hidden = false;
    $("blank").textContent = link.state === "down" ? "no daemon" : "the daemon is silent";
  } else if (back) {
    notice(link.starts > starts && starts ? "The daemon has restarted; this page follows it again." : "The daemon is back.", true);
    goodUntil = performance.now() + GOOD_MS;
  } else if (performance.now() > goodUntil && $("notice").textContent) notice("");
  if (up) starts = link.starts;
  lastLink = link.state;
  $("version").textContent = daemon ? `${daemon.camera.source}, ${daemon.camera.width} × ${daemon.camera.height} · ledpi ${daemon.version}` : "";
  const seen = panels.filter((panel) => panel.age_ms < 1000).length;
  document.title = up ? `ledpi: ${seen} ${seen === 1 ? "panel" : "panels"}` : "ledpi: no daemon";
  return back;
}

export function tellPanels(rows) {
  const body = $("panels").tBodies[0];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((panel, index) => {
    const row = body.rows[index] || body.insertRow();
    row.dataset.id = panel.id;
    row.classList.toggle("old", panel.age_ms > 500);
    cells(row, [
      String(panel.id),
      panel.distance_m === null ? "–" : `${panel.distance_m.toFixed(3)} m`,
      panel.yaw_deg === null ? "–" : `${number(panel.yaw_deg, 1)}°${panel.ambiguous ? "?" : ""}`,
      panel.age_ms < 2000 ? `${panel.age_ms.toFixed(0)} ms` : `${(panel.age_ms / 1000).toFixed(0)} s`,
      `${panel.rate_hz.toFixed(0)}/s`,
      panel.margin.toFixed(0),
    ]);
  });
  $("panels").hidden = !rows.length;
  $("no-panels").hidden = rows.length > 0;
}
