// The bodies on their way: played, stopped, and moved along the branch.

let clock = 0;
let playing = 0;

/** Where the bodies are now. */
function drawNow() {
  if (!moving) return;
  const { motion, bodies, scale } = moving,
    begin = motion.flights[0].t[0],
    time = begin + (clock % motion.span),
    states = stateAt(motion, time).map((state, i) => ({ ...state, i })),
    there = states.filter(({ x, v }) => Number.isFinite(x) && Number.isFinite(v));
  const [bottom, top] = scale.x.range();
  const svg = d3.select("#series");
  group(svg, "body")
    .selectAll("circle")
    .data(there)
    .join("circle")
    .attr("class", ({ i }) => `ball ${coordinateClass(i)}`)
    .attr("r", 7)
    .attr("cx", ({ i }) => bodies[i])
    .attr("cy", ({ x }) => scale.x(x));
  group(group(svg, "inside"), "now")
    .selectAll("line")
    .data([0])
    .join("line")
    .attr("class", "now")
    .attr("x1", scale.t(time))
    .attr("x2", scale.t(time))
    .attr("y1", bottom)
    .attr("y2", top);
  group(group(d3.select("#phase"), "inside"), "now")
    .selectAll("circle")
    .data(there)
    .join("circle")
    .attr("class", ({ i }) => `ball ${coordinateClass(i)}`)
    .attr("r", 5)
    .attr("cx", ({ x }) => scale.px(x))
    .attr("cy", ({ v }) => scale.pv(v));
}

/** Play or stop; a forcing period takes two seconds. @param {boolean} wanted */
function play(wanted) {
  cancelAnimationFrame(playing);
  playing = 0;
  const button = element("play");
  button.textContent = wanted ? "stop" : "play";
  button.setAttribute("aria-pressed", String(wanted));
  if (!wanted) return;
  let before = performance.now();
  const frame = (/** @type {number} */ now) => {
    clock += Math.min(now - before, 200) / 2000;
    before = now;
    drawNow();
    playing = requestAnimationFrame(frame);
  };
  playing = requestAnimationFrame(frame);
}

element("play").addEventListener("click", () => play(!playing));
element("slider").addEventListener("input", (event) => {
  const place = placeOf(state.at);
  if (place) choose(atRow(place.family, Number(/** @type {HTMLInputElement} */ (event.target).value)));
});
