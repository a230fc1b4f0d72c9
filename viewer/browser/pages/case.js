"use strict";

// Rerun's viewer with one recording, paused at its moment, or with what the live hub sends.

const RETRY_MS = 200;

function say(text) {
  document.getElementById("state").textContent = text;
}

// Requests of Rerun's control interface are Protobuf messages; this much of it is enough.
function varint(value) {
  const bytes = [];
  for (let rest = BigInt(value); ; rest >>= 7n) {
    if (rest < 128n) return [...bytes, Number(rest)];
    bytes.push(Number(rest & 127n) | 128);
  }
}

function field(number, bytes) {
  return [(number << 3) | 2, ...varint(bytes.length), ...bytes];
}

function pauseRequest(timeline, timeNs) {
  const name = field(1, [...new TextEncoder().encode(timeline)]);
  const time = [1 << 3, ...varint(timeNs)];
  const paused = [5 << 3, 1];
  return Uint8Array.from(field(6, [...field(2, name), ...field(3, time), ...paused]));
}

async function pause(handle, seconds) {
  const request = pauseRequest("sim_time", Math.round(seconds * 1e9));
  for (;;) {
    try {
      return await handle.viewer_control(request);
    } catch {
      // The recording is not there yet.
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
    }
  }
}

function watch(handle) {
  if (handle.has_panicked()) {
    say(`The viewer has crashed; reload the page. ${handle.panic_message()}`);
  } else {
    setTimeout(() => watch(handle), 1000);
  }
}

async function viewer(url) {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const handle = new wasm_bindgen.WebHandle({
    url: [url],
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    render_backend: "webgl",
    theme: "dark",
    persist: false,
    enable_history: false,
  });
  await handle.start(document.getElementById("canvas"));
  watch(handle);
  window.viewer = handle;
  return handle;
}

function moment(row) {
  const asked = /#when=sim_time@\+?([0-9.]+)s/.exec(location.hash);
  // Null of a recording that plays by itself.
  return asked ? Number(asked[1]) : row.moment_s;
}

async function showRecording(row, single) {
  document.title = row.case;
  document.getElementById("back").hidden = single;
  const title = document.getElementById("title");
  const verdict = (row.verdict || "no verdict").replaceAll("_", " ");
  title.textContent = single ? row.case : `${row.case}: ${verdict}`;
  title.className = row.verdict;
  const run = single ? "" : `${encodeURIComponent(row.run)}/`;
  const file = `${run}${encodeURIComponent(row.case)}.rrd`;
  const handle = await viewer(`${location.origin}/recording/${file}`);
  const stop = async () => {
    const seconds = moment(row);
    if (seconds === null) return say("");
    say("Loading the recording ...");
    await pause(handle, seconds);
    say(`Paused at ${seconds} s${row.complete ? "" : "; the recording is incomplete"}`);
  };
  window.addEventListener("hashchange", stop);
  await stop();
}

async function showLive() {
  document.title = "Live";
  const handle = await viewer(`rerun+http://${location.host}/proxy`);
  // The list of what there is: the wall and the single cases.
  handle.override_panel_state("blueprint", "expanded");
  say("Live");
  startPanel();
}

async function start() {
  const asked = new URLSearchParams(location.search);
  const [run, id] = [asked.get("run") || "", asked.get("case") || ""];
  const query = `run=${encodeURIComponent(run)}&case=${encodeURIComponent(id)}`;
  const answer = await fetch(`about.json?${query}`);
  if (!answer.ok) throw new Error(await answer.text());
  const about = await answer.json();
  if (about.live) await showLive();
  else await showRecording({ run: about.name, ...about.cases[0] }, Boolean(about.single));
}

start().catch((error) => say(String(error.message || error)));
