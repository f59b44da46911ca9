// The page of one flight. CONTENT is what flight.py says.
const flight = new Stack($("stack"), CONTENT.begin_s, CONTENT.end_s, { parted: CONTENT.counterfactual_s });
const signed = (t) => `${t < 0 ? "" : "+"}${t.toFixed(3)}`;
const band = (name) => CONTENT.bands.find((each) => each.name === name);
const hues = {};

function hue(text) { // one colour for one text, in the order in which they come
  if (hues[text] === undefined) hues[text] = MODES[Object.keys(hues).length % MODES.length];
  return hues[text];
}

const GREYS = { IDLE: "#ced4da", COMPLETE: "#b2f2bb", FAILED: "#ff6b6b", HOLDING: "#ffe066", LANDING: "#ffa94d" };
function colourOf(kind, text) {
  if (kind === "state") return CONTENT.colours[text.split("/")[0]] || "#adb5bd";
  if (kind === "code") return CODES[text] || "#adb5bd";
  if (kind === "mode") return hue(text);
  if (kind === "vehicle") return /failsafe|pilot/.test(text) ? "#ff8787" : /on the ground|disarmed/.test(text) ? "#ced4da" : /landing|taking/.test(text) ? "#ffa94d" : "#91a7ff";
  return GREYS[text.split(" ")[0]] || "#a5d8ff";
}

// --- head -------------------------------------------------------------------------------------------------------------

$("title").textContent = CONTENT.title;
if (CONTENT.result) $("title").append(" ", element("span", CONTENT.result.replace(/_/g, " "), { class: `result ${CONTENT.result}` }));
$("verdict").textContent = [CONTENT.begins, CONTENT.verdict].filter(Boolean).join(" · ");
const marks = [];
if (CONTENT.counterfactual_s !== null) marks.push(`~ Counterfactual after ${signed(CONTENT.counterfactual_s)} s (grey): there the recorded vehicle did something else than what is decided here. Its sensors are still those of the recording.`);
if (CONTENT.scripted.length) marks.push(`~ Scripted, not recorded: ${CONTENT.scripted.join(", ")}.`);
$("marks").textContent = marks.join(" ");
for (const [name, value] of CONTENT.facts) {
  const box = $("facts").appendChild(element("div"));
  box.append(element("small", name), element("span", value));
}

// --- what happened ----------------------------------------------------------------------------------------------------

const shown = band(CONTENT.background);
flight.backgrounds = shown.spans.map(([begin, end, text]) => [begin, end, colourOf(shown.kind, text)]);
const rows = CONTENT.bands.filter((each) => each.spans.length).map((each) => ({
  name: `${each.scripted ? "~ " : ""}${each.name}`, scripted: each.scripted, colour: (text) => colourOf(each.kind, each.kind === "code" ? text.split(" ")[0] : text),
  spans: each.kind === "code" ? each.spans.map(([begin, end, code]) => [begin, end, CODE_NAMES[code] || code]) : each.spans,
}));
const levels = () => [themed("dot"), themed("warn"), themed("bad")];
const points = (kinds) => CONTENT.events.map((each, number) => [each, number]).filter(([each]) => kinds.includes(each.kind))
  .map(([each, number]) => [each.t, `${signed(each.t)} s  ${each.text}`, levels()[each.level], number]);
flight.add(new Bands("What happened", rows, [
  { name: "decisions", points: points(["decision"]) },
  { name: "messages", points: points(["message", "text"]), symbol: "circle" },
], (number) => { if (typeof number === "number") choose(number); }));

// --- track ------------------------------------------------------------------------------------------------------------

function track() {
  const { labels, label } = CONTENT.track, [t, x, y, z] = ["t", "x", "y", "z"].map((name) => numbers(CONTENT.track[name]));
  $("stack").appendChild(element("h2", `${CONTENT.track.scripted ? "~ " : ""}Track, ${CONTENT.track.about}`));
  const pair = $("stack").appendChild(element("div", undefined, { class: "pair own" }));
  const [flat, solid] = [pair.appendChild(element("div")), pair.appendChild(element("div"))];
  const parts = (number) => { // of one label, with a break wherever another one was
    const found = { x: [], y: [], z: [], t: [] };
    label.forEach((each, at) => {
      const joins = each === number || (at > 0 && label[at - 1] === number);
      const put = (name, value) => found[name].push(joins && !Number.isNaN(value) ? value : null);
      if (joins || (found.x.length && found.x[found.x.length - 1] !== null)) { put("x", x[at]); put("y", y[at]); put("z", z[at]); found.t.push(t[at]); }
    });
    return found;
  };
  const figures = () => {
    const ink = themed("ink"), grid = themed("grid"), soft = themed("soft"), axis = { gridcolor: grid, zerolinecolor: grid, color: ink, tickfont: { size: 10 } };
    const both = (more) => ({ paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 11 }, margin: { l: 44, r: 8, t: 8, b: 36 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", font: { size: 10 } }, uirevision: 1, ...more });
    const line = (number) => ({ color: number < 0 ? soft : colourOf(shown.kind, labels[number]), width: 3 });
    const made = { flat: [], solid: [] };
    CONTENT.track.planned.forEach((file, number) => {
      const [px, py, pz] = [0, 1, 2].map((at) => file.map((each) => each[at])), name = number ? "" : "mission";
      const look = { name, showlegend: !number, mode: "lines+markers", line: { color: soft, dash: "dot", width: 1.5 }, marker: { size: 6, color: soft, symbol: "circle-open" }, hoverinfo: "skip" };
      made.flat.push({ type: "scatter", x: px, y: py, ...look });
      made.solid.push({ type: "scatter3d", x: px, y: py, z: pz, ...look, showlegend: false, line: { color: soft, dash: "dot", width: 2 }, marker: { size: 3, color: soft } });
    });
    const around = ([east, north], radius) => Array.from({ length: 73 }, (_, at) => at * Math.PI / 36)
      .map((angle) => [east + radius * Math.cos(angle), north + radius * Math.sin(angle)]);
    const areas = [...CONTENT.track.fences.map((each) => [each.in, [...each.corners, each.corners[0]]]),
      ...CONTENT.track.circles.map((each) => [each.in, around(each.centre, each.radius)])];
    areas.forEach(([inside, corners]) => {
      const name = inside ? "fence" : "keep out", showlegend = !made.flat.some((each) => each.name === name);
      made.flat.push({ type: "scatter", name, legendgroup: name, showlegend, mode: "lines", x: corners.map((each) => each[0]), y: corners.map((each) => each[1]), line: { color: themed("bad"), width: 1.5, dash: inside ? "dash" : "dot" }, hoverinfo: "skip" });
    });
    [...new Set(label)].forEach((number) => {
      const part = parts(number), name = number < 0 ? "no mode" : escaped(labels[number]);
      made.flat.push({ type: "scatter", name, mode: "lines", x: part.x, y: part.y, customdata: part.t, line: line(number), hoverinfo: "none" });
      made.solid.push({ type: "scatter3d", name, showlegend: false, mode: "lines", x: part.x, y: part.y, z: part.z, line: { ...line(number), width: 5 }, hoverinfo: "skip" });
    });
    const home = { name: "takeoff place", mode: "markers", hoverinfo: "skip" };
    if (!CONTENT.track.about.includes("estimate")) {
      made.flat.push({ type: "scatter", x: [0], y: [0], ...home, marker: { size: 11, symbol: "cross-thin", line: { width: 2, color: ink } } });
      made.solid.push({ type: "scatter3d", x: [0], y: [0], z: [0], ...home, showlegend: false, marker: { size: 4, symbol: "cross", color: ink } });
    }
    const here = { name: "cursor", showlegend: false, mode: "markers", hoverinfo: "skip" };
    made.flat.push({ type: "scatter", x: [null], y: [null], ...here, marker: { size: 11, color: themed("bad"), line: { color: themed("paper"), width: 2 } } });
    made.solid.push({ type: "scatter3d", x: [null], y: [null], z: [null], ...here, marker: { size: 5, color: themed("bad") } });
    const span = (values) => { const good = [...values].filter((each) => !Number.isNaN(each)); return good.length ? good.reduce((most, each) => Math.max(most, each), -Infinity) - good.reduce((least, each) => Math.min(least, each), Infinity) : 1; };
    const wide = Math.max(span(x), span(y), span(z), 1), share = (values) => Math.max(span(values) / wide, 0.25);
    return [
      [made.flat, both({ hovermode: "closest", xaxis: { ...axis, title: { text: "east [m]", standoff: 4 } }, yaxis: { ...axis, scaleanchor: "x", title: { text: "north [m]", standoff: 4 } } })],
      [made.solid, both({ showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, scene: { aspectmode: "manual", aspectratio: { x: share(x), y: share(y), z: share(z) }, xaxis: { ...axis, title: { text: "east" } }, yaxis: { ...axis, title: { text: "north" } }, zaxis: { ...axis, title: { text: "up" } }, camera: { eye: { x: -1.1, y: -1.5, z: 0.9 } } } })],
    ];
  };
  let last = [-1, -1], waiting = false;
  const draw = () => {
    const [one, other] = figures();
    last = [one[0].length - 1, other[0].length - 1];
    Plotly.react(flat, ...one, PLAIN);
    if (solid.data) Plotly.react(solid, ...other, PLAIN);
  };
  // The picture in three dimensions takes seconds where there is no graphics card: it is drawn for who wants it.
  const button = solid.appendChild(element("button", "Show in three dimensions", { id: "solid" }));
  button.onclick = () => { button.remove(); Plotly.react(solid, ...figures()[1], PLAIN); };
  const put = () => {
    waiting = false;
    const at = place(t, flight.t);
    if (at < 0) return;
    Plotly.restyle(flat, { x: [[x[at]]], y: [[y[at]]] }, [last[0]]);
    if (solid.data) Plotly.restyle(solid, { x: [[x[at]]], y: [[y[at]]], z: [[z[at]]] }, [last[1]]);
  };
  flight.onCursor.push(() => { if (!waiting) { waiting = true; setTimeout(put, 60); } });
  new IntersectionObserver((entries, watch) => {
    if (!entries[0].isIntersecting) return;
    watch.disconnect();
    draw();
    flat.on("plotly_hover", (event) => { const at = event.points[0].customdata; if (at !== undefined) flight.cursor(at); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  }, { rootMargin: "100px" }).observe(pair);
}

if (CONTENT.track) track();
for (const plot of CONTENT.plots) flight.add(new Lines(plot));

// --- rates ------------------------------------------------------------------------------------------------------------

class Rates {
  constructor(rates) {
    Object.assign(this, { title: "Rates", rates, height: 34 + 20 * rates.topics.length });
  }

  setHead(head) {
    head.append(element("b", "Rates of the watched topics"), element("span", `share of the expected rate over ${this.rates.bin_s} s; red lines are silences`, { class: "hint" }));
    this.words = head.appendChild(element("span", "", { class: "hint words" }));
  }

  told(t) {
    const at = Math.floor(t / this.rates.bin_s);
    this.words.textContent = this.rates.topics.filter((each) => each.bins[at] !== undefined).map((each) => `${each.component || each.topic} ${each.bins[at].toFixed(each.bins[at] < 10 ? 1 : 0)} Hz`).join(" · ");
  }

  figure(stack) {
    const { topics, bin_s: wide } = this.rates, expected = (each) => each.expected_hz || each.rate_hz || 1;
    const names = topics.map((each) => escaped(cut(each.component || each.topic, 18)));
    const heat = {
      type: "heatmap", x0: wide / 2, dx: wide, y: topics.map((_, at) => at), z: topics.map((each) => each.bins.map((rate) => rate / expected(each))), zmin: 0, zmax: 1.5, showscale: false, ygap: 3,
      colorscale: [[0, "#e03131"], [0.2, "#f76707"], [0.5, "#ffd43b"], [0.6, "#74b816"], [0.667, "#37b24d"], [0.8, "#22b8cf"], [1, "#4263eb"]], hoverinfo: "skip",
    };
    const x = [], y = [];
    topics.forEach((each, at) => each.gaps.forEach(([begin, end]) => { x.push(begin, end, null); y.push(at, at, null); }));
    const gaps = { type: "scatter", mode: "lines", x, y, line: { color: themed("bad"), width: 7 }, hoverinfo: "skip" };
    const yaxis = { tickvals: names.map((_, at) => at), ticktext: names, range: [names.length - 0.5, -0.5], showgrid: false };
    return [[heat, gaps], layoutOf(stack, this.height, { yaxis })];
  }
}

if (CONTENT.rates.topics.length) {
  flight.add(new Rates(CONTENT.rates));
  const table = $("charts").appendChild(element("table", undefined, { id: "rates" }));
  const head = table.appendChild(element("tr"));
  for (const text of ["component", "topic", "messages", "rate [Hz]", "expected [Hz]", "longest silence [s]", "at"]) head.appendChild(element("th", text));
  for (const each of CONTENT.rates.topics) {
    const row = table.appendChild(element("tr"));
    row.append(element("td", each.component), element("td", each.topic));
    const late = each.rate_hz === null || (each.expected_hz && each.rate_hz < 0.8 * each.expected_hz);
    const figures = [each.messages, each.rate_hz === null ? "–" : each.rate_hz.toFixed(2), each.expected_hz === null ? "" : each.expected_hz, each.longest_s === null ? "–" : each.longest_s.toFixed(3)];
    figures.forEach((value, at) => row.appendChild(element("td", value, { class: at === 1 && late ? "n late" : "n" })));
    const cell = row.appendChild(element("td"));
    if (each.longest_at_s !== null) cell.appendChild(element("button", signed(each.longest_at_s))).onclick = () => { flight.show(each.longest_at_s); scrollTo({ top: 0, behavior: "smooth" }); };
  }
}

// --- timeline ---------------------------------------------------------------------------------------------------------

const items = CONTENT.events.map((each, number) => {
  const other = each.scripted || each.counterfactual;
  const item = element("li", undefined, { class: `${each.kind} l${each.level}${other ? " other" : ""}` });
  item.appendChild(element("span", `${other ? "~ " : ""}${signed(each.t)}`, { class: "t" }));
  const said = item.appendChild(element("span", undefined, { class: "said" })), at = each.kind === "decision" ? each.text.indexOf("  by ") : -1;
  said.append(at < 0 ? each.text : each.text.slice(0, at));
  if (at >= 0) said.appendChild(element("small", ` ${each.text.slice(at + 2)}`));
  if (each.times > 1) said.append(` [${each.times} times until ${signed(each.until)}]`);
  item.title = `from: ${each.source}${each.counterfactual ? ", counterfactual" : ""}`;
  item.onclick = () => { choose(number); };
  return item;
});
$("events").append(...items);
if (CONTENT.events_left_out) $("events").append(element("li", `and ${CONTENT.events_left_out} more lines, which timeline.txt has`));

function choose(number) {
  flight.show(CONTENT.events[number].t);
  mark(number);
}

let marked = null;
function mark(number) {
  if (marked !== null) items[marked].classList.remove("now");
  marked = number;
  items[number].classList.add("now");
  const list = $("events"), top = items[number].offsetTop - list.offsetTop;
  if (top < list.scrollTop || top > list.scrollTop + list.clientHeight - 40) list.scrollTop = top - list.clientHeight / 3;
}

const times = CONTENT.events.map((each) => each.t);
flight.onCursor.push((t) => {
  const at = place(times, t + 1e-9);
  if (at >= 0 && (marked === null || CONTENT.events[marked].t !== CONTENT.events[at].t)) mark(at);
});

const NAMES = { decision: "decisions", message: "messages", monitor: "monitors", text: "vehicle's texts", note: "notes" }, off = new Set();
function filter() {
  const wanted = $("filter").value.toLowerCase();
  CONTENT.events.forEach((each, number) => { items[number].hidden = off.has(each.kind) || !each.text.toLowerCase().includes(wanted); items[number].style.display = items[number].hidden ? "none" : ""; });
}
for (const kind of Object.keys(NAMES)) {
  const count = CONTENT.events.filter((each) => each.kind === kind).length;
  if (!count) continue;
  const button = $("kinds").appendChild(element("button", `${count} ${NAMES[kind]}`));
  button.onclick = () => { if (!off.delete(kind)) off.add(kind); button.classList.toggle("off", off.has(kind)); filter(); };
}
$("filter").oninput = filter;
if (CONTENT.below.length) $("below").append(element("h2", "Figures"), element("pre", CONTENT.below.join("\n")));

$("closer").onclick = () => flight.zoom(0.5);
$("farther").onclick = () => flight.zoom(2);
$("whole").onclick = () => flight.view(flight.first, flight.last);
document.onkeydown = (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.id === "filter") return;
  const acts = { "+": () => flight.zoom(0.5), "-": () => flight.zoom(2), 0: () => flight.view(flight.first, flight.last) };
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (acts[event.key]) acts[event.key]();
  else if (step && marked !== null && items[marked + step]) { event.preventDefault(); choose(marked + step); }
};
