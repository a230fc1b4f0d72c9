"use strict";

// The control panel: a hand on one running case. The token comes with the address that `viewer web`
// printed; without it the panel stays away.

const WEATHERS = [
  "clear", "cloudy", "light_fog", "heavy_fog",
  "light_rain", "heavy_rain", "light_snow", "heavy_snow",
];
const LOOK_MS = 1000;
const DRIVE_MS = 100;
const STEER_STEP_RAD = 0.03;
const STEER_MAX_RAD = 0.5;
const KEYS = {
  ArrowUp: "gas", w: "gas", ArrowDown: "brake", s: "brake", " ": "brake",
  ArrowLeft: "left", a: "left", ArrowRight: "right", d: "right",
};

let panelToken = "";
let cases = [];
let driving = null; // the attempt that is driven by hand
let steering = 0;
const pressed = new Set();

const part = (id) => document.getElementById(id);

function chosen() {
  return driving || cases.find((state) => key(state) === part("which").value);
}

function key(state) {
  return `${state.campaign}/${state.case}`;
}

function tell(text, error = false) {
  part("hand").textContent = text;
  part("hand").className = error ? "error" : "";
}

function described(state) {
  const doing = state.taken_over ? "by hand, W A S D or arrows" : state.paused ? "paused" : "running";
  const verdict = state.changes ? ", no verdict" : "";
  const seconds = (state.sim_time_ns / 1e9).toFixed(2);
  const weather = (state.weather || "own weather").replaceAll("_", " ");
  return `${doing}: tick ${state.tick}, ${seconds} s, ${state.speed_mps.toFixed(1)} m/s, ${weather}${verdict}`;
}

async function ask(state, body) {
  const { campaign, case: name, token } = state;
  const answer = await fetch("/steer", {
    method: "POST",
    headers: { "Content-Type": "application/json", "X-Steer-Token": panelToken },
    body: JSON.stringify({ campaign, case: name, token, ...body }),
  });
  if (!(answer.headers.get("Content-Type") || "").includes("json")) throw new Error(answer.statusText);
  const reply = await answer.json();
  if (reply.error) throw new Error(reply.error);
  tell(described(reply.state));
  return reply;
}

async function act(body) {
  const state = chosen();
  if (!state) return tell("no case runs that can be steered", true);
  try {
    await ask(state, body);
  } catch (error) {
    tell(error.message, true);
  }
}

function shownCases() {
  const select = part("which");
  const names = cases.map(key);
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    const before = select.value;
    select.replaceChildren(...cases.map((state) => new Option(state.case, key(state))));
    if (names.includes(before)) select.value = before;
  }
  for (const button of document.querySelectorAll("#panel button")) button.disabled = !cases.length;
}

async function look() {
  try {
    const answer = await fetch("/running.json");
    if (!answer.ok) throw new Error(await answer.text());
    cases = await answer.json();
    shownCases();
    const state = chosen();
    const now = state && cases.find((other) => other.token === state.token);
    if (driving && !now) stopDriving("the case has ended");
    else if (now && !driving && !part("hand").classList.contains("error")) tell(described(now));
    else if (!cases.length && !driving) tell("no case runs that can be steered");
  } catch (error) {
    tell(error.message, true);
  }
  setTimeout(look, LOOK_MS);
}

// Keys that are held down are pedals that are held down.
function pedals() {
  const turn = Number(pressed.has("left")) - Number(pressed.has("right"));
  steering = turn
    ? Math.max(-STEER_MAX_RAD, Math.min(STEER_MAX_RAD, steering + turn * STEER_STEP_RAD))
    : steering / 2;
  const brake = pressed.has("brake") ? 0.7 : 0;
  return {
    action: "takeover",
    throttle: pressed.has("gas") && !brake ? 0.6 : 0,
    brake,
    steering_rad: Math.abs(steering) < 0.005 ? 0 : Number(steering.toFixed(3)),
  };
}

async function drive() {
  const state = driving;
  if (!state) return;
  try {
    await ask(state, { action: pedals() });
  } catch (error) {
    return stopDriving(error.message);
  }
  setTimeout(drive, DRIVE_MS);
}

function stopDriving(text = "") {
  driving = null;
  pressed.clear();
  part("take").setAttribute("aria-pressed", "false");
  part("take").textContent = "Take over";
  part("which").disabled = false;
  if (text) tell(text, true);
}

async function takeOver() {
  if (driving) {
    const state = driving;
    stopDriving();
    try {
      await ask(state, { action: { action: "release" } });
    } catch (error) {
      tell(error.message, true);
    }
    return;
  }
  driving = chosen() || null;
  if (!driving) return;
  steering = 0;
  part("take").setAttribute("aria-pressed", "true");
  part("take").textContent = "Give back";
  part("which").disabled = true;
  drive();
}

function onKey(event) {
  const name = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!driving || !name) return;
  // The viewer has keys of its own.
  event.preventDefault();
  event.stopPropagation();
  if (event.type === "keydown") pressed.add(name);
  else pressed.delete(name);
}

function startPanel() {
  const match = /#steer=([\w-]+)/.exec(location.hash);
  if (match) {
    // Neither in the history nor in a copied address; a reload still has it.
    sessionStorage.setItem("steer", match[1]);
    history.replaceState(null, "", location.pathname + location.search);
  }
  panelToken = sessionStorage.getItem("steer") || "";
  if (!panelToken) return;
  part("weather").replaceChildren(
    new Option("as it is", ""),
    ...WEATHERS.map((name) => new Option(name.replaceAll("_", " "), name)),
  );
  part("pause").onclick = () => act({ action: { action: "pause" } });
  part("step").onclick = () => act({ action: { action: "step" } });
  part("resume").onclick = () => act({ action: { action: "resume" } });
  part("set").onclick = () => {
    const settings = {};
    if (part("weather").value) settings.weather = part("weather").value;
    if (part("hour").value !== "") settings.hour = Number(part("hour").value);
    if (!Object.keys(settings).length) return tell("choose a weather or an hour", true);
    return act({ settings });
  };
  part("take").onclick = takeOver;
  part("which").onchange = () => tell("");
  for (const type of ["keydown", "keyup"]) window.addEventListener(type, onKey, true);
  window.addEventListener("blur", () => pressed.clear());
  part("panel").hidden = false;
  look();
}
