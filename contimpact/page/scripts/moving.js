// The bodies on their way: played, stopped, and moved along the branch.

let clock = 0;
let playing = 0;

/** Where everything is now. */
function drawNow() {
  if (!moving) return;
  const { motion, machine, scale } = moving,
    begin = motion.flights[0].t[0],
    time = begin + (clock % motion.span),
    states = stateAt(motion, time);
  machine?.moved(states);
  const [bottom, top] = scale.x.range(),
    series = group(d3.select("#series"), "inside");
  group(series, "now")
    .selectAll("line")
    .data([0])
    .join("line")
    .attr("class", "now")
    .attr("x1", scale.t(time))
    .attr("x2", scale.t(time))
    .attr("y1", bottom)
    .attr("y2", top);
  dot(
    series,
    states,
    () => scale.t(time),
    ({ x }) => scale.x(x),
  );
  dot(
    group(d3.select("#phase"), "inside"),
    states,
    ({ x }) => scale.px(x),
    ({ v }) => scale.pv(v),
  );
}

/** A dot for each coordinate that has a value now. @param {Selected} inside @param {States} states @param {(state: States[0]) => number} across @param {(state: States[0]) => number} up */
function dot(inside, states, across, up) {
  group(inside, "dots")
    .selectAll("circle")
    .data(states)
    .join("circle")
    .attr("class", (_, i) => `ball ${coordinateClass(i)}`)
    .attr("visibility", ({ x, v }) => (Number.isFinite(x) && Number.isFinite(v) ? null : "hidden"))
    .attr("r", 5)
    .attr("cx", (state) => finite(across(state)))
    .attr("cy", (state) => finite(up(state)));
}

/** A number that a picture takes. @param {number} value */
function finite(value) {
  return Number.isFinite(value) ? value : 0;
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
