// The operator's page: places what the server sends, keeps the link, gives commands. Its words come from the server.
// Texts go into text nodes, never into markup: a mission or a peer may be called anything.
"use strict";

const $ = (id) => document.getElementById(id);
const TICK_MS = 250, OLD_S = 3, GIVE_UP_S = 15, AGAIN_S = 2, MOST_PAUSE_S = 4, MOST_MESSAGES = 400, MOST_SAMPLES = 1200, MOST_TRACK = 2400;
const RECORDER = ["START_RECORDING", "DATA_CLEANUP"]; // what it does is what is waited for
const CHECKED = ["PREFLIGHT", "OUTREACH", "READY", "START_RECORDING", "LOAD_MISSION"];
const LEVELS = [["", ""], ["WARNING", "warn"], ["ERROR", "bad"], ["ALARM", "bad"]];
const NOTHING = { name: "WAITING", tone: "warn", where: [], in_flight: false, takes_mission: false, left_s: null, limit: "",
  message: "", level: 0, advice: "", waiting_for: "", faults: [], checks: [], readings: [], commands: [], waypoint: [0, 0],
  recording: "", progress: null, data: "" }; // what is shown of an engine that this server has not heard yet
const DRIFT = 0.0005; // by which two clocks may go apart
const ANSWERS = { "DONE": "good", "ALREADY": "info", "REFUSED": "bad", "NO ANSWER": "bad", "NOT SENT": "bad" };

const have = { board: "", run: "", note: 0, sample: 0 };
const orders = new Map();
let parts = {}, samples = [], flown = [], step = 1, socket = null, pauseS = 0.25, connected = false;
let heardMs = 0, stateMs = 0, beat = 0, beatMs = 0, ageS = null, wayS = Infinity, lateS = 0;
let willShow = false, toDraw = false, tickedMs = 0;
let question = null, answer = null, token = "", mayCommand = false, sound = null, soundedMs = 0, chimed = "";

const ticker = window.Worker ? new Worker("clock.js") : null; // in a tab that is not in front, too
const nowMs = () => performance.now();
const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
const unheard = () => !parts.state || Boolean(lost());

function element(tag, text = "", classes = "", tone = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (classes) made.className = classes;
  if (tone) made.dataset.tone = tone;
  return made;
}

function fill(id, children) {
  const made = $(id).cloneNode();
  made.append(...children);
  if (!made.isEqualNode($(id))) $(id).replaceChildren(...made.childNodes); // what is selected stays selected
}

function fillTable(id, headings, rows) {
  const head = element("tr");
  head.append(...headings.map((each) => element("th", each)));
  fill(id, rows.length ? [head, ...rows] : []);
}

// --- link: one web socket, opened anew when it closes or is silent; the server says what is missing ---

function connect() {
  const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream`);
  socket = mine;
  mine.onopen = () => say({ have, token });
  mine.onmessage = (event) => { if (mine === socket) take(JSON.parse(event.data)); };
  mine.onclose = () => { if (mine === socket) connectAgain(); };
  mine.begunMs = nowMs();
}

function connectAgain() {
  const old = socket;
  socket = null;
  old.close();
  setTimeout(connect, pauseS * 1000 * (0.75 + Math.random() / 2));
  pauseS = Math.min(MOST_PAUSE_S, pauseS * 2);
}

function say(what) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(what));
}

function take(news) {
  heardMs = nowMs();
  connected = true;
  pauseS = 0.25;
  if ("token" in news) {
    mayCommand = news.token;
    return render();
  }
  if (news.board !== have.board) {
    [parts, samples, flown, step, have.sample, have.board] = [{}, [], [], 1, 0, news.board];
    wayS = Infinity;
  }
  measureTheWay(news.beat);
  [beat, beatMs, ageS] = [news.beat, heardMs, news.age_s];
  Object.assign(parts, news.parts);
  if (news.parts.state) stateMs = heardMs - (ageS + lateS) * 1000;
  if (news.parts.missions && question && question.what.missions) { // its text is that of the list before
    tell(question.words, "NOT SENT", "the missions are listed anew: choose again.");
    question = null;
  }
  takeNotes(news);
  takeSamples(news);
  news.answers.forEach(takeAnswer);
  $("viewers").textContent = news.viewers === 1 ? "1 viewer" : `${news.viewers} viewers`;
  show(Boolean(news.samples.length || news.parts.state || news.parts.plans));
}

function show(plots) { // once for all messages that wait: to draw for each would show each of them later, and later
  toDraw = toDraw || plots;
  if (willShow) return;
  willShow = true;
  setTimeout(() => {
    [willShow, plots, toDraw] = [false, toDraw, false];
    render();
    if (plots) draw();
  });
}

function measureTheWay(sentS) { // what was longer under way than the fastest is older by that; no clock is set by another
  const way = heardMs / 1000 - sentS;
  wayS = Math.min(way, wayS + (heardMs - beatMs) / 1000 * DRIFT);
  lateS = way - wayS;
}

function takeSamples(news) {
  if (samples.length && samples[0][0] < news.flight) [samples, flown, step] = [[], [], 1]; // another mission's
  for (const sample of news.samples) {
    if (sample[0] <= have.sample) continue;
    have.sample = sample[0];
    samples.push(sample);
    if (sample[0] % step === 0) flown.push(sample); // as the server thins them: all of the flight, and no more
    if (flown.length > MOST_TRACK) { step *= 2; flown = flown.filter((each) => each[0] % step === 0); }
  }
  samples = samples.slice(-MOST_SAMPLES);
}

function takeNotes(news) {
  if (news.run !== have.run) {
    $("messages").replaceChildren();
    [have.run, have.note] = [news.run, 0];
  }
  for (const [number, time, level, text, advice] of news.notes) {
    if (number <= have.note) continue;
    have.note = number;
    const [word, tone] = LEVELS[Math.min(3, level)], row = element("li");
    row.append(element("time", time), word ? element("span", word, "label", tone) : "", ` ${text} `);
    row.append(element("span", advice, "advice"));
    $("messages").prepend(row);
  }
  while ($("messages").childElementCount > MOST_MESSAGES) $("messages").lastElementChild.remove();
}

// --- commands: each has an id and is sent again until it is answered; the server carries out each id once. What the
// engine would answer is never said in its place: the vehicle may fly by now. ---

const nameOfState = () => (parts.state ? parts.state.name : "");

function offered() { // without contact what stops the vehicle or brings it down
  if (unheard()) return parts.safe || [];
  return parts.state.commands.filter((each) => each.possible || (each.name === "land" && each.verdict === "ALREADY"));
}

function isPossible({ missions, command }) { // the engine has an answer to LAND in every state
  if (missions) return Boolean(parts.state && parts.state.takes_mission);
  return command === "land" || offered().some((each) => each.name === command);
}

function give(what, words) {
  const id = Array.from(crypto.getRandomValues(new Uint32Array(4))).join("-");
  const body = { id, ...what, seen: nameOfState(), board: have.board, beat };
  const order = { id, words, body, givenMs: nowMs(), sentMs: 0 };
  orders.set(id, order);
  send(order);
  render();
}

function send(order) {
  order.sentMs = nowMs();
  say({ order: { ...order.body, token } });
}

function takeAnswer(said) {
  const order = orders.get(said.id);
  orders.delete(said.id);
  if (order) tell(order.words, said.verdict, said.message);
}

function tell(words, verdict, message) {
  answer = { words, verdict, message, atMs: nowMs(), state: nameOfState() };
}

function press({ name, words, question: text }) {
  if (text) ask(text, { command: name }, words);
  else give({ command: name }, words);
}

function ask(text, what, words) {
  question = { text, what, words, atMs: nowMs() };
  render();
}

function forgetTheLate() {
  if (question && !isPossible(question.what)) {
    tell(question.words, "NOT SENT", unheard() ? "no contact." : "not possible any more.");
    question = null;
  } else if (question && nowMs() - question.atMs > 10000) {
    tell(question.words, "NOT SENT", "not confirmed in time.");
    question = null;
  }
  for (const order of orders.values()) {
    if (nowMs() - order.givenMs > GIVE_UP_S * 1000) {
      orders.delete(order.id);
      tell(order.words, "NO ANSWER", "Whether it has arrived is not known. Look at the state.");
    } else if (nowMs() - order.sentMs > AGAIN_S * 1000) send(order);
  }
  if (answer && nowMs() - answer.atMs > (answer.state === nameOfState() ? 15000 : 2000)) answer = null;
}

function useToken(given) {
  token = given;
  try { sessionStorage.setItem("token", given); } catch (error) { /* it lasts as long as this page */ }
  say({ token });
}

$("yes").onclick = () => {
  const asked = question;
  question = null;
  if (asked) give(asked.what, asked.words);
};
$("no").onclick = () => {
  question = null;
  render();
};
$("token-form").onsubmit = (event) => {
  event.preventDefault();
  useToken($("token").value.trim());
};

// --- what is shown ---

function lost() {
  const linkS = (nowMs() - heardMs) / 1000 + lateS, engineS = ageS === null ? 0 : ageS + (nowMs() - beatMs) / 1000;
  if (linkS > OLD_S) return `NO CONTACT with the vehicle's computer for ${Math.floor(linkS)} s.`;
  return engineS > OLD_S ? `THE ENGINE is silent for ${Math.floor(engineS)} s.` : "";
}

function render() {
  const state = parts.state || NOTHING, gone = lost();
  document.body.classList.toggle("old", Boolean(gone));
  $("lost").hidden = !gone;
  const watch = state.in_flight ? " Below is what was heard last: watch the vehicle, be ready to take over." : "";
  $("lost").textContent = gone ? gone + watch : "";
  const oldS = ((nowMs() - beatMs) / 1000 + lateS + (ageS || 0)).toFixed(1);
  const alive = parts.state ? `connected, ${oldS} s old` : "connected, no engine heard";
  $("link").textContent = gone || !connected ? "no contact" : mayCommand ? alive : `${alive}; commands need the token`;
  const waits = (parts.engine && parts.engine.link) || "Waiting for the engine. If it is not running: start the launch file.";
  const passedS = (nowMs() - stateMs) / 1000, [word, tone] = LEVELS[Math.min(3, state.level)];
  document.title = $("state").textContent = connected ? state.name.replaceAll("_", " ") : "CONNECTING";
  $("band").dataset.tone = state.tone;
  $("left").textContent = state.left_s === null ? "" : clock(Math.max(0, state.left_s - passedS));
  const where = parts.state ? [...state.where, state.limit ? `time left: ${state.limit}` : ""] : [waits];
  $("where").textContent = where.filter(Boolean).join(" | ");
  const words = state.level >= LEVELS.length - 1 ? "" : state.message; // an alarm stands above, large
  fill("message", word ? [element("span", word, "", tone), ` ${words}`] : [words]);
  $("waiting").textContent = state.waiting_for ? `Waiting for: ${state.waiting_for}` : "";
  $("advice").textContent = state.advice;
  forgetTheLate();
  renderReadings(state);
  renderFaults(state, passedS);
  renderChecks(state);
  renderMissions(state);
  renderRecording(state);
  renderCommands();
  alarm(state, gone);
}

function renderReadings(state) {
  fill("readings", state.readings.map(([name, value, limit, warn]) => {
    const box = element("div", "", warn ? "reading warn" : "reading");
    box.append(element("span", name), element("b", value, value.length > 8 ? "long" : ""), element("small", limit.replace(/(\d) /g, "$1\u00a0")));
    return box;
  }));
}

function renderFaults(state, passedS) {
  $("faults-part").hidden = !state.faults.length;
  fill("faults", state.faults.map((group) => {
    const box = element("div", "", "fault");
    const left = group.left_s === null ? "" : ` ${clock(Math.max(0, group.left_s - passedS))} left (${group.limit})`;
    box.append(element("span", group.action, "label action", group.tone), element("b", left));
    if (group.faults.length > 1) box.append(element("p", `${group.cause}:`, "action"));
    for (const [name, code, reason] of group.faults) {
      const line = element("p");
      line.append(element("b", name), code ? `, code ${code}: ${reason}` : `: ${reason}`);
      box.append(line);
    }
    return box;
  }));
}

function renderChecks(state) {
  const order = ["FAIL", "UNKNOWN", "WARN", "PASS"];
  $("checks-part").hidden = !CHECKED.includes(state.name) || !state.checks.length;
  const rows = [...state.checks].sort((a, b) => order.indexOf(a.verdict) - order.indexOf(b.verdict));
  fillTable("checks", ["check", "verdict", "value", "limit", "age"], rows.map((each) => {
    const row = element("tr"), name = element("td", each.name), verdict = element("td");
    if (each.advice) name.append(element("span", each.advice, "advice"));
    verdict.append(element("span", each.verdict, "label", each.tone));
    row.append(name, verdict, ...[each.value, each.limit, each.age].map((text) => element("td", text, "number")));
    return row;
  }));
}

function renderMissions(state) {
  $("missions-part").hidden = !state.takes_mission;
  renew("missions", [parts.missions, mayCommand], () => (parts.missions || []).map((each) => {
    const button = element("button", "", "mission");
    button.disabled = Boolean(each.error) || !mayCommand;
    button.append(element("b", `${each.id}: ${each.words}`), element("span", each.duration));
    button.append(element("span", each.error ? `CANNOT BE FLOWN: ${each.error}` : `needs ${each.battery} of the battery`));
    button.onclick = () => choose(each);
    return button;
  }));
}

function choose(mission) { // what is pressed while the question is open follows; a finger that presses twice means once
  const before = question && question.what.missions ? question.what.missions : [];
  const missions = before.includes(mission.id) ? before : [...before, mission.id], names = missions.join(", ");
  if (missions.length > 1) ask(`Fly missions ${names}, one after the other?`, { missions }, `missions ${names}`);
  else ask(`${mission.question} Another mission pressed now is flown after it.`, { missions }, `mission ${names}`);
}

function renderCommands() {
  renew("commands", [offered(), mayCommand], () => offered().map((each) => {
    const button = element("button", each.words, each.name);
    button.disabled = !mayCommand;
    button.onclick = () => press(each);
    return button;
  }));
  $("question").hidden = !question;
  $("asked").textContent = question ? question.text : "";
  const [open] = orders.values();
  if (open) fill("answer", [`${open.words}: asked, no answer for ${Math.floor((nowMs() - open.givenMs) / 1000)} s`]);
  else if (!answer) fill("answer", []);
  else fill("answer", [`${answer.words}: `, element("b", answer.verdict, "", ANSWERS[answer.verdict]), ` ${answer.message}`]);
  $("bar").hidden = !$("commands").hasChildNodes() && !$("answer").hasChildNodes() && !question;
}

function renew(id, made_of, make) { // only what is different: a button that is replaced under a finger loses the press
  const shown = JSON.stringify(made_of);
  if ($(id).shown === shown) return;
  $(id).shown = shown;
  $(id).replaceChildren(...make());
}

function renderRecording(state) {
  const said = parts.recording || { platforms: [], left_s: null };
  $("recording-part").classList.toggle("now", RECORDER.includes(state.name));
  $("recording-part").hidden = !state.recording && !said.platforms.length;
  const done = state.progress === null ? "" : ` ${Math.round(state.progress * 100)} %`;
  const left = said.left_s === null ? "" : `, about ${clock(said.left_s)} left`;
  $("phase").textContent = `${state.recording.toLowerCase()}${done}${left}`;
  $("data").textContent = state.data ? `data: ${state.data}` : "";
  fillTable("platforms", ["platform", "written", "rate", "free", "CPU", ""], said.platforms.map((each) => {
    const row = element("tr"), last = element("td");
    const [words, tone] = each.growing ? ["records", "good"] : ["does not record", state.in_flight ? "bad" : ""];
    last.append(element("span", words, "label", tone));
    if (each.trouble) last.append(element("span", each.trouble, "advice"));
    if (each.dropped) last.append(element("span", `at least ${each.dropped} messages dropped`, "advice"));
    const numbers = [each.size, each.rate, each.free, each.cpu].map((text) => element("td", text, "number"));
    row.append(element("td", each.name), ...numbers, last);
    return row;
  }));
}

// --- alarm: by flash and sound ---

function alarm(state, gone) {
  const loud = state.level >= 3 || (Boolean(gone) && state.in_flight);
  $("alarm").hidden = state.level < 3;
  $("alarm").textContent = state.level >= 3 ? state.message : "";
  for (const id of ["alarm", "lost"]) $(id).classList.toggle("flash", loud);
  const urgent = state.level >= 1 ? `${state.name} ${state.message}` : "";
  if (loud) chime(1000, 0.35);
  else if (urgent && urgent !== chimed) chime(660, 0.25);
  chimed = urgent;
}

function chime(hertz, seconds) {
  if (!sound || nowMs() - soundedMs < 700) return;
  soundedMs = nowMs();
  const from = sound.currentTime, made = sound.createOscillator(), volume = sound.createGain();
  made.frequency.value = hertz;
  volume.gain.setValueAtTime(0.4, from);
  volume.gain.exponentialRampToValueAtTime(0.001, from + seconds);
  made.connect(volume).connect(sound.destination);
  made.start(from);
  made.stop(from + seconds);
}

$("sound").onclick = () => { // a browser makes no sound before somebody has touched the page
  if (sound) sound.close();
  sound = sound ? null : new AudioContext();
  soundedMs = 0;
  chime(880, 0.4);
  $("sound").textContent = sound ? "sound is on" : "sound is off";
  $("sound").setAttribute("aria-pressed", String(Boolean(sound)));
};

// --- track and plots: plotly's, where it is installed ---

const dark = matchMedia("(prefers-color-scheme: dark)");
const column = (at, scale = 1) => samples.map((each) => (each[at] === null ? null : each[at] * scale));

function colours() {
  return dark.matches
    ? { fore: "#ffffff", grid: "#444c54", track: "#4db2ff", plan: "#c8ccd0", limit: "#ff6b6b", home: "#ffd700" }
    : { fore: "#000000", grid: "#b8b8b8", track: "#005f9f", plan: "#555555", limit: "#c00000", home: "#a06000" };
}

function plot(id, traces, more) {
  const clear = "rgba(0,0,0,0)", legend = { orientation: "h", y: 1.02, yanchor: "bottom" };
  const layout = { paper_bgcolor: clear, plot_bgcolor: clear, font: { color: colours().fore, size: 14 }, legend, ...more };
  layout.margin = { l: 60, r: 10, t: 10, b: 45 };
  layout.uirevision = "kept"; // where somebody has zoomed in, it stays
  Plotly.react(id, traces, layout, { responsive: true, displayModeBar: false });
}

function draw() {
  const state = parts.state || NOTHING;
  if (!window.Plotly || document.hidden) return;
  drawTrack(colours(), state, (parts.plans || {})[state.mission]);
  drawPlots(colours(), state);
}

function circle([x, y], radius) {
  const angles = Array.from({ length: 73 }, (_, at) => at * Math.PI / 36);
  return angles.map((each) => [x + radius * Math.cos(each), y + radius * Math.sin(each)]);
}

function drawTrack(c, state, plan) {
  const traces = [];
  const add = (points, name, mode, more) =>
    traces.push({ x: points.map((p) => p[0]), y: points.map((p) => p[1]), name, mode, hoverinfo: "name+x+y", ...more });
  const files = plan ? plan.files.filter((points) => points.length) : [];
  files.forEach((points, at) => add(points, files.length > 1 ? `mission, file ${at + 1}` : "mission", "lines+markers",
    { line: { color: c.plan, width: 2, dash: "dot" }, marker: { size: 7, color: c.plan } }));
  for (const each of plan ? plan.fences : []) {
    add([...each.corners, each.corners[0]], each.in ? "fence" : "keep out", "lines", { line: { color: c.limit, width: 3 } });
  }
  for (const each of plan ? plan.circles : []) {
    add(circle(each.centre, each.radius), each.in ? "fence" : "keep out", "lines", { line: { color: c.limit, width: 3 } });
  }
  if (state.distance_limit) {
    add(circle([0, 0], state.distance_limit), `lands beyond ${state.distance_limit} m`, "lines",
      { line: { color: c.limit, width: 2, dash: "dash" }, visible: "legendonly" });
  }
  const [at, of] = state.waypoint, aim = state.in_flight && of && plan ? (plan.files[state.file] || [])[Math.max(0, at - 1)] : null;
  if (aim) add([aim], `waypoint ${at} of ${of}`, "markers", { marker: { size: 15, symbol: "circle-open", color: c.plan, line: { width: 3 } } });
  const first = samples.length ? samples[0][0] : 0, track = [...flown.filter((each) => each[0] < first), ...samples];
  add(track.map((each) => [each[2], each[3]]), "flown", "lines", { line: { color: c.track, width: 4 } });
  add([[0, 0]], "takeoff place", "markers", { marker: { symbol: "x", size: 13, color: c.home } });
  const last = [...samples].reverse().find((each) => each[2] !== null), outline = { width: 2, color: c.fore };
  const now = samples[samples.length - 1] === last ? "vehicle" : "vehicle, where it was heard last";
  if (last) add([[last[2], last[3]]], now, "markers", { marker: { size: 16, color: c.track, line: outline } });
  const atLeast = { include: [-2, 2] }; // metres: a vehicle that stands does not wander over the whole picture
  const axis = { gridcolor: c.grid, zerolinecolor: c.grid, autorangeoptions: atLeast };
  const yaxis = { ...axis, title: { text: "north, m" }, scaleanchor: "x" };
  plot("track", traces, { xaxis: { ...axis, title: { text: "east, m" } }, yaxis });
}

function drawPlots(c, state) {
  const last = samples[samples.length - 1];
  if (!last) return void Plotly.purge("plots");
  const times = samples.map((each) => (each[1] - last[1]) / 60), traces = [], axes = {};
  const rows = [["altitude, m", 4, 1, state.altitude_limit], ["speed, m/s", 5, 1, null],
    ["from home, m", 7, 1, state.distance_limit], ["battery, %", 6, 100, state.battery_limit]];
  rows.forEach(([name, at, scale, limit], row) => {
    const yaxis = row ? `y${row + 1}` : "y", y = column(at, scale), width = 2.5, of_battery = at === 6;
    traces.push({ x: times, y, name, yaxis, mode: "lines", line: { color: c.track, width } });
    if (limit && (of_battery || Math.max(0, ...y) > 0.7 * limit)) {
      const line = { color: c.limit, dash: "dash", width };
      traces.push({ x: [times[0], 0], y: [limit * scale, limit * scale], name: `${name}: limit`, yaxis, mode: "lines", line });
    }
    axes[row ? `yaxis${row + 1}` : "yaxis"] = { title: { text: name, font: { size: 13 } }, gridcolor: c.grid,
      zerolinecolor: c.grid, rangemode: "tozero", domain: [0.78 - row * 0.26, 1 - row * 0.26],
      ...(of_battery ? { range: [0, 100] } : {}) };
  });
  const xaxis = { title: { text: "minutes" }, gridcolor: c.grid, anchor: "y4" };
  plot("plots", traces, { ...axes, xaxis, hovermode: "x", showlegend: false });
}

// --- begin ---

function tick() {
  if (nowMs() - tickedMs < TICK_MS / 2) return; // the other one of both clocks was there
  tickedMs = nowMs();
  if (socket && nowMs() - Math.max(heardMs, socket.begunMs) > 2 * OLD_S * 1000) connectAgain();
  render();
}

function unescaped(typed) { // by hand somebody may have typed a bare %
  try { return decodeURIComponent(typed); } catch (error) { return typed; }
}

if (!window.Plotly) [$("track-part").hidden, $("plots-part").hidden, $("no-plots").hidden] = [true, true, false];
try { token = sessionStorage.getItem("token") || ""; } catch (error) { token = ""; }
if (location.hash.length > 1) {
  useToken(unescaped(location.hash.slice(1)));
  history.replaceState(null, "", location.pathname); // not into bookmarks, nor into pictures of the screen
}
dark.addEventListener("change", draw);
document.addEventListener("visibilitychange", draw);
heardMs = nowMs();
setInterval(tick, TICK_MS);
if (ticker) {
  ticker.onmessage = tick;
  ticker.postMessage(TICK_MS);
}
connect();
