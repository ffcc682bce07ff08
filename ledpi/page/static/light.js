// Focus with its best so far, exposure, gain, and the histogram.

import { $ } from "./server.js";
import { canvasOf, colour } from "./drawing.js";

let best = 0, bestOf = "";
export function forgetBest() { best = 0; }

export function drawLight(frame) {
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
  drawHistogram(frame.histogram);
}

function drawHistogram(bins) {
  const { context, width, height } = canvasOf($("histogram"));
  const most = Math.log1p(Math.max(...bins, 1)), step = width / bins.length;
  bins.forEach((count, index) => {
    const tall = (height * Math.log1p(count)) / most; // logarithmic: a panel is few pixels of many
    context.fillStyle = colour(index === bins.length - 1 ? "bad" : "accent");
    context.fillRect(index * step, height - tall, Math.max(step - 1, 1), tall);
  });
  $("histogram").setAttribute("aria-label", `Histogram of brightness; ${$("saturated").textContent} of the pixels are full`);
}
