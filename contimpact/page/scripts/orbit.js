// The chosen orbit: the machine, the phase plane, displacements over time, multipliers, numbers.

/** The height of these pictures. */
const PANEL = 230;
/** @type {{motion: Motion, machine: Machine | null, scale: {t: Linear, x: Linear, px: Linear, pv: Linear}} | null} */
let moving = null;
/** Multipliers beyond stand at the edge of their picture, with their size, so that the unit circle can be seen. */
const EDGE = 2.5;

/** Show the chosen orbit. */
function drawOrbit() {
  const place = placeOf(state.at);
  element("orbit-none").hidden = place !== null;
  element("orbit-shown").hidden = place === null;
  if (!place) {
    element("orbit-name").textContent = "Orbit";
    play(false);
    return;
  }
  const { family, row, entry } = place;
  if (entry) element("orbit-name").replaceChildren(labelOf(entry), ` (${entry.id}) on ${titleOf(family)}`);
  else element("orbit-name").textContent = titleOf(family);
  element("orbit-state").textContent = `${valueText(family, row)}; ${stateOf(family, row, entry)}`;
  const slider = /** @type {HTMLInputElement} */ (element("slider"));
  slider.max = String(family.rows - 1);
  slider.value = String(row);
  slider.setAttribute("aria-valuetext", `${placeText(family, row, 6)}, ${stateOf(family, row, entry)}`);
  const drawnRow = keptRow(family, row),
    motion = motionOf(family, drawnRow);
  for (const id of ["series", "phase", "machine"])
    /** @type {HTMLElement} */ (element(id).parentElement).hidden = !motion;
  /** @type {HTMLButtonElement} */ (element("play")).disabled = !motion;
  sayMissing(family, row, drawnRow, motion !== null);
  moving = null;
  if (motion) {
    const machine = drawMachine(motion, family, drawnRow),
      over = drawSeries(motion, family, drawnRow, entry),
      plane = drawPhase(motion, family, drawnRow, entry);
    moving = { motion, machine, scale: { ...over, ...plane } };
    drawNow();
  } else play(false);
  const multipliers = multipliersAt(family, row);
  /** @type {HTMLElement} */ (element("circle").parentElement).hidden = multipliers.length === 0;
  if (multipliers.length) drawCircle(multipliers);
  drawNumbers(family, row, entry);
}

/** Say why an orbit is not drawn, or another one than asked for. @param {Family} family @param {number} row @param {number} other @param {boolean} there */
function sayMissing(family, row, other, there) {
  const note = element("orbit-missing");
  note.hidden = there && row === other;
  if (!there) {
    note.textContent =
      family.word && page.unknown
        ? `The orbit cannot be drawn: ${page.unknown}.`
        : "The motion is not periodic, or has no impacts: only its impacts are recorded.";
  } else if (row !== other) {
    note.textContent = `This page holds one orbit of ${page.every}; drawn is that at ${placeText(family, other)}. The numbers are those of the point.`;
  }
}

/** The extent of all values of a motion, walls included. @param {Motion} motion @param {"x" | "v"} what @returns {[number, number]} */
function extentOf(motion, what) {
  const values = motion.flights
    .flatMap((flight) => flight[what].flatMap((each) => d3.extent(each)))
    .filter((value) => value !== undefined);
  if (what === "x") values.push(...motion.walls.map(([, at]) => at));
  return [d3.min(values) ?? 0, d3.max(values) ?? 1];
}

/** Draw a line through points; where there are none, it is interrupted. @param {Pen} pen @param {number[]} x @param {number[]} y */
function trace(pen, x, y) {
  let down = false;
  x.forEach((at, i) => {
    const there = Number.isFinite(at) && Number.isFinite(y[i]);
    if (there && down) pen.lineTo(at, y[i]);
    else if (there) pen.moveTo(at, y[i]);
    down = there;
  });
}

/** Where frames begin: names of several coordinates stand above. @param {Motion} motion */
function topOf({ coordinates }) {
  return coordinates.length > 1 ? 24 : 12;
}

/** The names of several coordinates above a frame, in the colours of their lines. @param {Selected} svg @param {Motion} motion @param {Box} box */
function drawNames(svg, { coordinates }, box) {
  let at = box.left;
  const names = coordinates.map((name) => {
    const place = at;
    at += 12 + 9 * symbol(name).length;
    return { name, place };
  });
  group(svg, "names")
    .selectAll("text")
    .data(names.length > 1 ? names : [])
    .join("text")
    .attr("class", (_, i) => `coordinate-name ${coordinateClass(i)}`)
    .attr("x", ({ place }) => place)
    .attr("y", box.top - 7)
    .text(({ name }) => symbol(name));
}

/** The class of a coordinate's lines. @param {number} place */
function coordinateClass(place) {
  return `coordinate${place % 4}`;
}

/** Lines across a picture for each wall. @param {Selected} layer @param {Motion} motion @param {(at: number, coordinate: number) => [number, number, number, number]} line */
function drawWalls(layer, motion, line) {
  layer
    .selectAll("line")
    .data(motion.walls)
    .join("line")
    .attr("class", ([name]) => `wall ${wallClass(page.walls.indexOf(name))}`)
    .attr("x1", ([, at, i]) => line(at, i)[0])
    .attr("y1", ([, at, i]) => line(at, i)[1])
    .attr("x2", ([, at, i]) => line(at, i)[2])
    .attr("y2", ([, at, i]) => line(at, i)[3]);
}

/** Displacements over time; returns the scales. @param {Motion} motion @param {Family} family @param {number} row @param {Entry | null} entry */
function drawSeries(motion, family, row, entry) {
  const svg = d3.select("#series"),
    width = sized(svg, PANEL),
    walls = wallsTogether(motion),
    widest = d3.max(walls, ({ names }) => names.join(", ").length) ?? 0,
    extent = widened(extentOf(motion, "x"), 0.07),
    box = {
      left: leftRoom(extent, 5),
      right: width - 12 - 10 * widest,
      top: topOf(motion),
      bottom: PANEL - 42,
    };
  const turns = motion.span === 1 ? 2 : 1,
    begin = motion.flights[0].t[0];
  const t = d3.scaleLinear([begin, begin + turns * motion.span], [box.left, box.right]);
  const x = d3.scaleLinear(extent, [box.bottom, box.top]);
  const inside = drawFrame(
    svg,
    box,
    { x: t, y: x },
    { x: "time in forcing periods", y: nameOfPlace(), ticks: [6, 5] },
  );
  drawWalls(group(inside, "lines"), motion, (at) => [box.left, x(at), box.right, x(at)]);
  const repeated = d3
    .range(turns)
    .flatMap((turn) => motion.flights.map((flight, k) => ({ flight, k, later: turn * motion.span })));
  const paths = motion.coordinates.map((_, i) => {
    const path = d3.pathRound(2);
    const times = repeated.flatMap(({ flight, later }) => flight.t.map((time) => t(time + later)));
    trace(path, times, repeated.flatMap(({ flight }) => flight.x[i]).map(x));
    return path.toString();
  });
  group(inside, "motion")
    .selectAll("path")
    .data(paths)
    .join("path")
    .attr("class", (_, i) => `path ${coordinateClass(i)}`)
    .attr("d", (d) => d);
  drawNames(svg, motion, box);
  const hits = repeated.flatMap(({ flight, k, later }) =>
    motion.hits[k].map((i) => ({
      t: flight.t[0] + later,
      x: flight.x[i][0],
      wall: family.walls[family.starts[row] + k],
    })),
  );
  group(inside, "impacts")
    .selectAll("circle")
    .data(hits)
    .join("circle")
    .attr("class", (hit) => `before ${wallClass(hit.wall)}`)
    .attr("r", 3.5)
    .attr("cx", (hit) => t(hit.t))
    .attr("cy", (hit) => x(hit.x));
  drawTouch(group(inside, "touches"), touches(motion, entry, family, row), ({ time }) => t(time), x);
  group(svg, "walls")
    .selectAll("text")
    .data(
      spread(
        walls.map((wall) => ({ ...wall, y: x(wall.place) })),
        16,
      ),
    )
    .join("text")
    .attr("class", ({ look }) => `wall-name ${look}`)
    .attr("x", box.right + 5)
    .attr("y", ({ y }) => y + 4)
    .text(({ names }) => names.join(", "));
  svg.attr("aria-label", `Displacement over time of ${titleOf(family)}`);
  return { t, x };
}

/** Where a grazing orbit touches: the time, and the coordinates that do. @param {Motion} motion @param {Entry | null} entry @param {Family} family @param {number} row */
function touches(motion, entry, family, row) {
  if (!entry || entry.touch_time === null || !entry.wall) return [];
  const T = tracksOf(family)?.period[row] ?? 1,
    begin = motion.flights[0].t[0],
    turn = Math.floor(family.times[family.starts[row]] / T),
    since = (entry.touch_time / T - turn - begin) % motion.span,
    time = begin + ((since + motion.span) % motion.span),
    state = stateAt(motion, time);
  return motion.touched(entry.wall).map((i) => ({ time, ...state[i] }));
}

/** The touch of a grazing. @param {Selected} layer @param {ReturnType<typeof touches>} found @param {(touch: {time: number, x: number}) => number} across @param {Linear} up @param {"x" | "v"} what */
function drawTouch(layer, found, across, up, what = "x") {
  layer
    .selectAll("circle")
    .data(found)
    .join("circle")
    .attr("class", "touch")
    .attr("r", 6)
    .attr("cx", across)
    .attr("cy", (touch) => up(touch[what]));
}

/** What coordinates are called: systems that are not drawn as machines may have one for each mode. */
function nameOfPlace() {
  return page.machine ? "displacement" : "coordinate of each mode";
}

/** The phase plane; returns its scales. @param {Motion} motion @param {Family} family @param {number} row @param {Entry | null} entry */
function drawPhase(motion, family, row, entry) {
  const svg = d3.select("#phase"),
    width = sized(svg, PANEL),
    extent = widened(extentOf(motion, "v"), 0.09),
    box = { left: leftRoom(extent, 5), right: width - 12, top: topOf(motion), bottom: PANEL - 42 };
  const x = d3.scaleLinear(widened(extentOf(motion, "x"), 0.09), [box.left, box.right]);
  const v = d3.scaleLinear(extent, [box.bottom, box.top]);
  const inside = drawFrame(svg, box, { x, y: v }, { x: nameOfPlace(), y: "velocity", ticks: [3, 5] });
  drawWalls(group(inside, "lines"), motion, (at) => [x(at), box.top, x(at), box.bottom]);
  const last = motion.flights[motion.flights.length - 1],
    jumps = d3.pathRound(2);
  const paths = motion.coordinates.map((_, i) => {
    const path = d3.pathRound(2);
    motion.flights.forEach((flight, k) => {
      const before = endOf(k ? motion.flights[k - 1] : last, i);
      trace(jumps, [x(before.x), x(flight.x[i][0])], [v(before.v), v(flight.v[i][0])]);
      trace(path, flight.x[i].map(x), flight.v[i].map(v));
    });
    return { name: `path ${coordinateClass(i)}`, d: path.toString() };
  });
  group(inside, "motion")
    .selectAll("path")
    .data([{ name: "jump", d: jumps.toString() }, ...paths])
    .join("path")
    .attr("class", ({ name }) => name)
    .attr("d", ({ d }) => d);
  drawNames(svg, motion, box);
  const hits = motion.flights.flatMap((flight, k) =>
    motion.hits[k].flatMap((i) => {
      const before = endOf(k ? motion.flights[k - 1] : last, i),
        wall = family.walls[family.starts[row] + k];
      return [
        { name: "before", wall, ...before },
        { name: "after", wall, x: flight.x[i][0], v: flight.v[i][0] },
      ];
    }),
  );
  group(inside, "impacts")
    .selectAll("circle")
    .data(hits)
    .join("circle")
    .attr("class", (hit) => `${hit.name} ${wallClass(hit.wall)}`)
    .attr("r", 3.5)
    .attr("cx", (hit) => x(hit.x))
    .attr("cy", (hit) => v(hit.v));
  const found = touches(motion, entry, family, row);
  drawTouch(group(inside, "touches"), found, (touch) => x(touch.x), v, "v");
  svg.attr("aria-label", `Phase plane of ${titleOf(family)}`);
  return { px: x, pv: v };
}

/** The state of a coordinate at the end of a flight. @param {Flight} flight @param {number} i */
function endOf({ x, v }, i) {
  const at = x[i].length - 1;
  return { x: x[i][at], v: v[i][at] };
}

/** Multipliers in the plane of complex numbers, and the unit circle. @param {[number, number][]} multipliers */
function drawCircle(multipliers) {
  const svg = d3.select("#circle"),
    side = Math.max(60, Math.min((element("circle").parentElement?.clientWidth || 300) - 72, PANEL - 54));
  sized(svg, side + 54);
  const finite = multipliers.filter(([re, im]) => Number.isFinite(re) && Number.isFinite(im));
  const far = Math.min(EDGE, Math.max(1.25, ...finite.map(([re, im]) => 1.1 * Math.hypot(re, im))));
  const box = { left: 60, right: 60 + side, top: 12, bottom: 12 + side };
  const x = d3.scaleLinear([-far, far], [box.left, box.right]),
    y = d3.scaleLinear([-far, far], [box.bottom, box.top]);
  const inside = drawFrame(svg, box, { x, y }, { x: "real", y: "imaginary", ticks: [3, 5] });
  const unit = group(inside, "unit-circle");
  unit
    .selectAll("circle")
    .data([0])
    .join("circle")
    .attr("class", "unit")
    .attr("cx", x(0))
    .attr("cy", y(0))
    .attr("r", x(1) - x(0));
  const placed = finite.map(([re, im]) => ({ re, im, at: within(re, im, 0.93 * far) }));
  group(inside, "multipliers")
    .selectAll("circle")
    .data(placed)
    .join("circle")
    .attr("r", 5)
    .attr("cx", ({ at }) => x(at[0]))
    .attr("cy", ({ at }) => y(at[1]))
    .attr("class", ({ re, im }) => (Math.hypot(re, im) > 1 ? "beyond" : "within"));
  group(inside, "far")
    .selectAll("text")
    .data(placed.filter(({ re, im, at }) => re !== at[0] || im !== at[1]))
    .join("text")
    .attr("class", "name")
    .attr("text-anchor", ({ at }) => (at[0] > 0 ? "end" : "start"))
    .attr("x", ({ at }) => x(at[0]))
    .attr("y", ({ at }, k) => y(at[1]) - 10 - 13 * k)
    .text(({ re, im }) => (im ? `size ${shown(Math.hypot(re, im), 4)}` : shown(re, 4)));
  svg.attr(
    "aria-label",
    `Multipliers: ${multipliers.map(([re, im]) => complex(re, im)).join("; ") || "none"}`,
  );
}

/** A number of the plane, or, if it is farther out than that, the place at the edge in its direction. @param {number} re @param {number} im @param {number} edge @returns {[number, number]} */
function within(re, im, edge) {
  const most = Math.max(Math.abs(re), Math.abs(im)),
    factor = most > edge ? edge / most : 1;
  return [factor * re, factor * im];
}

/** A table of texts, the first row its head. @param {string[][]} rows @param {string} caption */
function tableOf(rows, caption) {
  const table = document.createElement("table"),
    body = table.createTBody();
  table.createCaption().textContent = caption;
  table.caption?.classList.add("unseen");
  rows.forEach((cells, k) => {
    const row = k ? body.insertRow() : table.createTHead().insertRow();
    for (const text of cells) {
      const cell = document.createElement(k ? "td" : "th");
      if (!k) cell.scope = "col";
      cell.textContent = text;
      row.append(cell);
    }
  });
  return table;
}

/** All numbers of the orbit. @param {Family} family @param {number} row @param {Entry | null} entry */
function drawNumbers(family, row, entry) {
  const from = family.starts[row],
    count = family.starts[row + 1] - from;
  const impacts = Array.from({ length: count }, (_, k) => [
    String(k + 1),
    page.walls[family.walls[from + k]],
    shown(family.times[from + k], 10),
    shown(family.velocities[from + k], 12),
  ]);
  const facts = page.varying
    .filter((name) => family.columns[name])
    .map((name) => [withUnit(name), shown(family.columns[name][row], 15)]);
  multipliersAt(family, row).forEach(([re, im], j) =>
    facts.push([
      `multiplier ${j + 1}`,
      `${complex(re, im)}${im ? `, size ${shown(Math.hypot(re, im), 8)}` : ""}`,
    ]),
  );
  if (family.columns.smallest_gap) facts.push(["smallest gap", shown(family.columns.smallest_gap[row], 8)]);
  for (const name of page.quantities)
    if (name !== "margin" && Number.isFinite(family.columns[name]?.[row]))
      facts.push([name, shown(family.columns[name][row], 8)]);
  const margin = marginText(family, row);
  if (margin) facts.push(["margin (tolerances)", margin]);
  if (entry)
    facts.push(
      ["error of the parameter", shown(entry.error, 2)],
      ["residual", shown(entry.residual, 2)],
      ["found by", entry.method],
      ...[beyond(entry)].flatMap((text) => (text ? [["beyond it", text]] : [])),
    );
  if (entry?.opens.length) facts.push(["branches born here", entry.opens.join(", ")]);
  const { branch } = family;
  if (branch) {
    if (branch.from) facts.push(["branch born at", branch.from]);
    facts.push(["first end", branch.ends[0]], ["last end", branch.ends[1]]);
    for (const text of branch.missed) facts.push(["not located", text]);
    for (const text of branch.notes) facts.push(["note", text]);
  }
  element("orbit-impacts").replaceChildren(
    ...(count ? [tableOf([["#", "wall", "time", "velocity"], ...impacts], "Impacts")] : []),
  );
  element("orbit-numbers").replaceChildren(tableOf([["quantity", "value"], ...facts], "The orbit's numbers"));
}
