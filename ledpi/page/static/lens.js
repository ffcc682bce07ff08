// The lens, calibrated by a board before the daemon's camera.

import { $, ask, pause } from "./server.js";
import { html } from "./drawing.js";
import { download } from "./actions.js";

export async function nextBoard() {
  if (!$("board").open) {
    await new Promise((done) => $("board").addEventListener("toggle", done, { once: true }));
  }
  tellBoard(await (await ask("api/board")).json());
  await pause(400);
}

function tellBoard(told) {
  const runs = told !== null && told.runs;
  $("board-start").disabled = runs;
  $("board-stop").hidden = !runs;
  if (told === null) {
    $("board-says").textContent = "";
    return;
  }
  $("board-says").textContent = told.says;
  const rms = told.rms_px === null ? "" : `; the lens explains them to ${told.rms_px.toFixed(3)} px (rms)`;
  $("board-found").textContent = `${told.views} views of ${told.enough} or more${rms}. ${told.lens_says}`;
  $("lens").hidden = told.rms_px === null;
  $("coverage").hidden = false;
  $("coverage").setAttribute("aria-label", `Corners in the parts of the picture, row by row: ${told.coverage.map((row) => row.join(" ")).join("; ")}`);
  $("coverage").replaceChildren(...told.coverage.flat().map((count) => html("span", count ? "seen" : "", String(count))));
}

$("board-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const asked = new URLSearchParams({ kind: $("board-kind").value, cols: $("board-cols").value, rows: $("board-rows").value });
  try {
    tellBoard(await (await ask(`api/board/start?${asked}`, "POST")).json());
  } catch (error) {
    $("board-says").textContent = `Not done: ${error.message}`;
  }
});
$("board-stop").addEventListener("click", () => ask("api/board/stop", "POST").then((answer) => answer.json()).then(tellBoard, () => {}));
$("lens").addEventListener("click", () => download("api/camera.yaml", "camera.yaml"));
