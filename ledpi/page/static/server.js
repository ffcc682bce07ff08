// Asking the server: with the token, for ever, and by its clock.

export const $ = (id) => document.getElementById(id);

let token = sessionStorage.getItem("token") || "";
if (location.hash.startsWith("#token=")) {
  token = decodeURIComponent(location.hash.slice(7));
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname); // it is not left in the address bar
}

export class Refused extends Error {}
export class LoginNeeded extends Error {}

let lastAnswer = performance.now();
export const silentFor = () => performance.now() - lastAnswer;

export async function ask(path, method = "GET", within_ms = method === "POST" ? 130000 : 15000, body = undefined) {
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  const answer = await fetch(path, { method, headers, body, cache: "no-store", signal: AbortSignal.timeout(within_ms) });
  lastAnswer = performance.now();
  if (answer.status === 401) throw new LoginNeeded();
  if (!answer.ok) throw new Refused((await answer.json()).error);
  return answer;
}

export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// For ever; what fails is tried again.
export async function again(step) {
  for (;;) {
    try {
      await step();
    } catch (error) {
      if (error instanceof LoginNeeded) await login();
      else {
        if (!(error instanceof Refused || error instanceof TypeError || error instanceof DOMException)) console.error(error);
        await pause(error instanceof Refused ? 1000 : 500);
      }
    }
  }
}

export function notice(text, good = false) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
  $("notice").classList.toggle("good", good);
}

let loggingIn = null;
export const isLoggingIn = () => loggingIn !== null;

export function login() {
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
      done();
    }, { once: true });
  });
  return loggingIn;
}

// ---- The server's clock (CLOCK_MONOTONIC), from the answers that were under way for the shortest time

let clock = { offset_ms: 0, under_way_ms: Infinity };
export function see(told, asked_ms, got_ms) {
  const came = told.came_ns / 1e6, sent = told.sent_ns / 1e6;
  const underWay = got_ms - asked_ms - (sent - came);
  clock.under_way_ms += 0.01; // clocks drift: an old measurement is trusted less and less
  if (underWay <= clock.under_way_ms) clock = { offset_ms: (came - asked_ms + (sent - got_ms)) / 2, under_way_ms: underWay };
}
export const ageOf = (exposed_ns) => performance.now() + clock.offset_ms - exposed_ns / 1e6;
