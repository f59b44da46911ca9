// The report of a suite of scenarios. CONTENT is what report_pages.py says.
const COLOURS = CONTENT.colours;
const MARKS = { fault: ["faults", "#f783ac"], user: ["user", "#748ffc"], counterfactual: ["another flight", "#dee2e6"], script: ["~ script", "#e9ecef"] };
const SIGNS = { PASS: "✓", FAIL: "✗", ERROR: "!", VACUOUS: "∅", INCONCLUSIVE: "?" };
let shown = null; // the chart on show: what the keys act on

function list(filter) {
  $("list").replaceChildren();
  CONTENT.tests.forEach((test, number) => {
    const words = [test.id, test.verdict, ...test.tags, ...test.moments.map((each) => each.rule)].join(" ").toLowerCase();
    if (filter && !words.includes(filter.toLowerCase())) return;
    const item = element("li", undefined, { class: test.verdict, title: `${test.verdict}: ${test.headline}`, tabindex: 0 });
    item.appendChild(element("span", SIGNS[test.verdict], { class: test.verdict, "aria-label": test.verdict }));
    item.appendChild(document.createTextNode(test.id));
    item.classList.toggle("chosen", shown !== null && shown.number === number);
    item.dataset.number = number;
    item.onclick = () => show(number);
    item.onkeydown = (event) => { if (event.key === "Enter") show(number); };
    $("list").appendChild(item);
  });
}

function lanes(test) {
  const rows = [], state = (value) => COLOURS[value.split("/")[0]];
  if (test.golden.length) rows.push(["states, golden", test.golden, state]);
  rows.push([test.golden.length ? "states, new" : "states", test.states, state]);
  for (const [kind, [name, colour]] of Object.entries(MARKS)) {
    const bars = test.marks.filter((mark) => mark[0] === kind);
    const spans = bars.map(([, begin, end, text]) => [begin, end === null ? test.end_s : end, text]);
    parted(spans).forEach((each, level) => rows.push([level ? "" : name, each, () => colour]));
  }
  for (const [name, spans] of Object.entries(test.codes)) {
    rows.push([name, spans.map(([begin, end, code]) => [begin, end, CODE_NAMES[code]]), (value) => CODES[value.split(" ")[0]]]);
  }
  if (test.quiet.length) {
    const name = Object.keys(test.codes).length ? "other components" : "components";
    rows.push([name, [[0, test.end_s, `1 nominal: ${test.quiet.join(", ")}`]], () => CODES[1]]);
  }
  test.expectations.forEach((each, number) => {
    const [begin, end] = test.windows[number];
    if (begin !== null) {
      const colour = { PASS: "#8ce99a", FAIL: "#ff8787", VACUOUS: "#ffc078" }[each.grade];
      rows.push([`expects ${number + 1}`, [[begin, end, each.expectation]], () => colour]);
    }
  });
  return rows;
}

function parted(spans) {
  const levels = [];
  for (const span of [...spans].sort((one, other) => one[0] - other[0])) {
    const free = levels.find((level) => level[level.length - 1][1] <= span[0]);
    if (free) free.push(span);
    else levels.push([span]);
  }
  return levels;
}

// The chart of a test: lanes, decisions and height over one time. A decision that is not the golden's is red or grey.
function chart(test, place, told) {
  const moments = [...test.moments].sort((one, other) => one.t - other.t), first = moments.find((each) => each.change);
  const stack = new Stack(place, 0, Math.max(test.end_s, 0.001), {});
  let chosen = null;
  const tell = (what) => {
    chosen = what;
    told.textContent = Array.isArray(what) ? `${what[3]}: ${what[2]}\nfrom ${what[0]} s to ${what[1]} s` : describe(what);
    stack.show(Array.isArray(what) ? what[0] : what.t);
  };
  const colour = (moment) => themed(moment.change === "removed" ? "open" : moment.change ? "bad" : "dot");
  const rows = lanes(test).map(([name, spans, hue]) => ({ name, colour: hue, spans: spans.map((span) => [...span.slice(0, 3), name]) }));
  const points = moments.map((each) => [each.t, `${each.t} s ${each.move} by ${each.rule}${each.change ? `, ${each.change}` : ""}`, colour(each), each]);
  stack.add(new Bands("Over time", rows, [{ name: "decisions", points, symbol: "circle" }], tell));
  if (test.height) stack.add(new Lines(test.height));
  const step = (by) => {
    const now = moments.indexOf(chosen), next = moments[now < 0 ? (by > 0 ? 0 : moments.length - 1) : now + by];
    if (next !== undefined) tell(next);
  };
  const difference = () => {
    if (first === undefined) return;
    stack.view(first.t - 2.5, first.t + 2.5);
    tell(first);
  };
  const acts = { "+": () => stack.zoom(0.5), "-": () => stack.zoom(2), 0: () => stack.view(stack.first, stack.last), f: difference, ArrowRight: () => step(1), ArrowLeft: () => step(-1) };
  const tools = element("p", "Drag: zoom. Double click: all. ", { class: "hint" });
  const tool = (text, key) => { tools.appendChild(element("button", text, { title: `key ${key}` })).onclick = acts[key]; };
  for (const [text, key] of [["+", "+"], ["−", "-"], ["all", "0"], ["‹ decision", "ArrowLeft"], ["decision ›", "ArrowRight"]]) tool(text, key);
  if (first !== undefined) tool("first difference", "f");
  tools.appendChild(element("br"));
  for (const [key, what] of [["↑ ↓", "scenario"], ["← →", "decision"], ["+ − 0", "zoom"], ["f", "first difference"], ["/", "filter"]]) {
    tools.appendChild(element("kbd", key));
    tools.appendChild(document.createTextNode(` ${what}  `));
  }
  if (first !== undefined) tell(first);
  return { stack, tools, acts };
}

function describe(moment) {
  const lines = [`${moment.t} s  ${moment.move}`, `rule ${moment.rule}, on ${moment.event}`, ...moment.values.map((each) => `  ${each}`)];
  if (moment.commands.length) lines.push(`=> ${moment.commands.join(", ")}`);
  if (moment.change) lines.push(`against the golden: ${moment.change}`);
  return lines.join("\n");
}

function show(number) {
  const test = CONTENT.tests[number];
  if (shown !== null && shown.stack) shown.stack.close();
  shown = { number, acts: {} };
  for (const item of document.querySelectorAll("li")) {
    const chosen = Number(item.dataset.number) === number;
    item.classList.toggle("chosen", chosen);
    if (chosen) item.scrollIntoView({ block: "nearest" });
  }
  remember(test.id);
  const main = $("main");
  main.replaceChildren();
  main.appendChild(element("h2", test.id));
  main.appendChild(element("p", test.description));
  const head = main.appendChild(element("p"));
  head.appendChild(element("span", test.verdict, { class: `verdict ${test.verdict}` }));
  head.appendChild(document.createTextNode(test.headline));
  if (test.states.length) {
    const told = element("pre", "Click a bar or a decision for its values.", { "aria-live": "polite" });
    const made = chart(test, main.appendChild(element("div")), told);
    main.append(made.tools, told);
    Object.assign(shown, made);
  }
  if (test.difference.length) {
    main.appendChild(element("h3", "Against the golden"));
    main.appendChild(element("pre", test.difference.join("\n")));
  }
  if (test.problems.length) main.appendChild(element("pre", test.problems.join("\n")));
  expectations(main, test);
  main.appendChild(element("h3", "Run it alone"));
  main.appendChild(element("pre", test.command, { class: "command" }));
  const known = [["tags", test.tags], ["proves", test.requirements]].filter((each) => each[1].length);
  if (known.length) main.appendChild(element("p", known.map(([what, all]) => `${what}: ${all.join(", ")}`).join("; "), { class: "hint" }));
}

function remember(name) {
  try { history.replaceState(null, "", `#${encodeURIComponent(name)}`); } catch { /* a page inside another one may not */ }
}

function expectations(main, test) {
  if (!test.expectations.length) return;
  main.appendChild(element("h3", "Expectations"));
  const table = main.appendChild(element("table"));
  test.expectations.forEach((each, number) => {
    const row = table.appendChild(element("tr"));
    row.appendChild(element("td", number + 1));
    row.appendChild(element("td")).appendChild(element("span", `${SIGNS[each.grade]} ${each.grade}`, { class: each.grade }));
    for (const text of [each.expectation, each.text, test.margins[number]]) row.appendChild(element("td", text));
  });
}

function table(title, head, rows, kind) {
  const main = $("main");
  if (shown !== null && shown.stack) shown.stack.close();
  shown = null;
  for (const item of document.querySelectorAll("li")) item.classList.remove("chosen");
  main.replaceChildren(element("h2", title));
  const made = main.appendChild(element("table"));
  const first = made.appendChild(element("tr"));
  for (const text of head) first.appendChild(element("th", text));
  for (const values of rows) {
    const row = made.appendChild(element("tr", undefined, { class: kind(values) }));
    for (const value of values) row.appendChild(Array.isArray(value) ? links(value) : element("td", value));
  }
}

function links(names) {
  const cell = element("td");
  for (const name of names) {
    const number = CONTENT.tests.findIndex((test) => test.id === name);
    cell.appendChild(element("button", name, { class: "link" })).onclick = () => show(number);
  }
  return cell;
}

function coverage() {
  const rows = CONTENT.coverage.map(([name, places, values, waiver]) => {
    const how = places.length ? "fired" : waiver ? "waived" : "missing";
    return [name, how, places.length, places.slice(0, 3), how === "waived" ? waiver : values];
  });
  const many = (how) => rows.filter((row) => row[1] === how).length;
  const title = `${many("fired")} of ${rows.length} rows fired, ${many("waived")} waived, ${many("missing")} missing`;
  const head = ["Row", "", "Scenarios", "First", "What its guard looked at, or why it is waived"];
  const order = { missing: 0, waived: 1, fired: 2 };
  rows.sort((one, other) => order[one[1]] - order[other[1]]);
  table(title, head, rows, (row) => row[1]);
}

function speed() {
  const rows = CONTENT.tests.map((test) => {
    const { flown_s: flown, wall_s: wall, cpu_s: cpu, peak_mb: peak } = test.figures;
    return [[test.id], flown.toFixed(1), wall.toFixed(3), (flown / Math.max(wall, 1e-9)).toFixed(0), cpu.toFixed(3), peak.toFixed(0)];
  });
  table("Speed", ["Scenario", "flight s", "wall s", "x real time", "CPU s", "peak MB"], rows, () => "");
}

const counts = {};
for (const test of CONTENT.tests) counts[test.verdict] = (counts[test.verdict] || 0) + 1;
const failed = CONTENT.tests.length - (counts.PASS || 0);
$("summary").textContent = `${failed ? `${failed} of ${CONTENT.tests.length} did not pass` : `${CONTENT.tests.length} passed`}; ${CONTENT.flown_s} s of flight in ${CONTENT.wall_s} s`;
document.title = `${failed ? `${failed} ✗` : "✓"} Scenarios`;
const filter = (text) => { $("filter").value = text; list(text); };
for (const [verdict, count] of Object.entries(counts)) {
  const button = $("counts").appendChild(element("button", `${SIGNS[verdict]} ${count} ${verdict}`, { title: "show these only" }));
  button.onclick = () => filter($("filter").value === verdict ? "" : verdict);
}
$("filter").oninput = (event) => list(event.target.value);
$("show-coverage").onclick = () => { coverage(); remember("coverage"); };
$("show-speed").onclick = () => { speed(); remember("speed"); };

function walk(by) {
  const numbers = [...document.querySelectorAll("li")].map((item) => Number(item.dataset.number));
  const at = shown === null ? -1 : numbers.indexOf(shown.number);
  const next = numbers[at < 0 ? (by > 0 ? 0 : numbers.length - 1) : at + by];
  if (next !== undefined) show(next);
}

document.onkeydown = (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.id === "filter") {
    if (event.key === "Escape") filter("");
    if (event.key === "Enter") walk(1);
    if (event.key === "Escape" || event.key === "Enter") $("filter").blur();
    return;
  }
  const acts = { ArrowDown: () => walk(1), ArrowUp: () => walk(-1), "/": () => $("filter").focus(), ...(shown ? shown.acts : {}) };
  if (acts[event.key] === undefined) return;
  event.preventDefault();
  acts[event.key]();
};
function goThere() {
  const wanted = decodeURIComponent(location.hash.slice(1));
  if (wanted === "coverage") coverage();
  else if (wanted === "speed") speed();
  else if (CONTENT.tests.length) show(Math.max(CONTENT.tests.findIndex((test) => test.id === wanted), 0));
}

list("");
goThere();
window.onhashchange = goThere;
