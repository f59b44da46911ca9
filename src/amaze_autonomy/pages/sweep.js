// A sweep: across the time of the fault, down the flight in the colours of its states; the line is the fault itself.
const BANDS = ["#dbe4ff", "#ffe8cc", "#d3f9d8", "#ffe3e3", "#eebefa", "#c5f6fa", "#fff3bf", "#e9ecef"];
$("title").textContent = CONTENT.title;
$("about").textContent = CONTENT.about;

function picture() {
  const { bars, regions, boundaries, began } = CONTENT, ink = themed("ink");
  const flights = {
    type: "bar", x: bars.map((each) => each[0]), base: bars.map((each) => each[2]), y: bars.map((each) => each[3] - each[2]), width: bars.map((each) => each[1]), hoverinfo: "text",
    marker: { color: bars.map((each) => CONTENT.colours[each[4]] || "#adb5bd"), line: { width: 0 } }, hovertext: bars.map((each) => `fault ${each[5]} s: ${each[4]}<br>${each[2]} s to ${each[3]} s`),
  };
  const fault = { type: "scatter", mode: "lines", x: began.map((each) => each[0]), y: began.map((each) => each[1]), line: { color: "#1c2430", width: 1.5 }, hoverinfo: "skip" };
  const outcomes = [...new Set(regions.map((each) => each[2]))];
  const shapes = regions.map(([x0, x1, outcome]) => ({ type: "rect", yref: "paper", x0, x1, y0: 1.01, y1: 1.06, fillcolor: BANDS[outcomes.indexOf(outcome) % BANDS.length], line: { width: 0 } }));
  const annotations = regions.map(([x0, x1, outcome]) => ({ yref: "paper", x: (x0 + x1) / 2, y: 1.035, text: CONTENT.letters[outcome], showarrow: false, font: { color: "#1c2430" } }));
  boundaries.forEach(([after, before], number) => {
    const x = (after + before) / 2;
    shapes.push({ type: "line", yref: "paper", x0: x, x1: x, y0: 0, y1: 1.06, line: { color: themed("bad"), width: 1.5, dash: "dash" } });
    annotations.push({ yref: "paper", x, y: 1.085 + 0.03 * (number % 2), text: `${before.toFixed(2)} s`, showarrow: false });
  });
  Plotly.react("picture", [flights, fault], {
    height: 620, barmode: "overlay", bargap: 0, showlegend: false, margin: { l: 60, r: 20, t: 80, b: 50 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink }, shapes, annotations, hovermode: "closest",
    xaxis: { title: { text: `time of the fault, ${escaped(CONTENT.clock)} [s]` }, gridcolor: themed("grid"), zeroline: false }, yaxis: { autorange: "reversed", title: { text: "flight [s]" }, gridcolor: themed("grid"), zeroline: false },
  }, PLAIN);
}

function fill(table, head, rows) {
  const first = $(table).appendChild(element("tr"));
  for (const text of head) first.appendChild(element("th", text));
  for (const values of rows) {
    const row = $(table).appendChild(element("tr"));
    for (const value of values) row.appendChild(element("td", value));
  }
}

for (const state of new Set(CONTENT.bars.map((each) => each[4]))) {
  $("legend").appendChild(element("span", state)).style.background = CONTENT.colours[state] || "#adb5bd";
}
fill("outcomes", ["", "Motions commanded", "Runs"], Object.entries(CONTENT.letters).map(([outcome, letter]) => [letter, outcome, CONTENT.runs[outcome]]));
fill("boundaries", ["Last before", "First after", "Outcome"], CONTENT.boundaries.map(([after, before, one, other]) => [`${after.toFixed(3)} s`, `${before.toFixed(3)} s`, `${CONTENT.letters[one]} → ${CONTENT.letters[other]}`]));
picture();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", picture);
