// The body on its way: played, stopped, and moved along the branch.

let clock = 0;
let playing = 0;

/** Where the body is now. */
function drawNow() {
  if (!moving) return;
  const { motion, scale } = moving,
    begin = motion.flights[0].t[0],
    time = begin + (clock % motion.span);
  const flight =
    motion.flights.find(({ t }) => time <= t[t.length - 1]) ?? motion.flights[motion.flights.length - 1];
  const k = Math.max(1, Math.min(flight.t.length - 1, d3.bisectLeft(flight.t, time)));
  const part = (time - flight.t[k - 1]) / (flight.t[k] - flight.t[k - 1] || 1);
  const x = flight.x[k - 1] + part * (flight.x[k] - flight.x[k - 1]),
    v = flight.v[k - 1] + part * (flight.v[k] - flight.v[k - 1]);
  const right = scale.t.range()[1],
    [bottom, top] = scale.x.range();
  const svg = d3.select("#series");
  group(svg, "body")
    .selectAll("circle")
    .data([0])
    .join("circle")
    .attr("class", "ball")
    .attr("r", 7)
    .attr("cx", right + 30)
    .attr("cy", scale.x(x));
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
    .data([0])
    .join("circle")
    .attr("class", "ball")
    .attr("r", 5)
    .attr("cx", scale.px(x))
    .attr("cy", scale.pv(v));
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
