// The chosen orbit: displacement over time, phase plane, multipliers, and the body between its walls.

/** @type {{motion: Motion, scale: {t: Linear, x: Linear, px: Linear, pv: Linear}} | null} */
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
  element("orbit-name").textContent = titleOf(family, entry);
  element("orbit-state").textContent = `${placeText(family, row)}; ${stateOf(family, row, entry)}`;
  const slider = /** @type {HTMLInputElement} */ (element("slider"));
  slider.max = String(family.rows - 1);
  slider.value = String(row);
  slider.setAttribute("aria-valuetext", `${placeText(family, row, 6)}, ${stateOf(family, row, entry)}`);
  const drawnRow = keptRow(family, row),
    motion = motionOf(family, drawnRow);
  for (const id of ["series", "phase"])
    /** @type {HTMLElement} */ (element(id).parentElement).hidden = !motion;
  /** @type {HTMLButtonElement} */ (element("play")).disabled = !motion;
  sayMissing(family, row, drawnRow, motion !== null);
  moving = null;
  if (motion) {
    drawSeries(motion, family, drawnRow, entry);
    drawPhase(motion, family, drawnRow, entry);
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
    .flatMap((flight) => d3.extent(flight[what]))
    .filter((value) => value !== undefined);
  if (what === "x") values.push(...motion.walls.map(([, at]) => at));
  return [d3.min(values) ?? 0, d3.max(values) ?? 1];
}

/** Lines across a picture for each wall. @param {Selected} layer @param {Motion} motion @param {(at: number) => [number, number, number, number]} line */
function drawWalls(layer, motion, line) {
  layer
    .selectAll("line")
    .data(motion.walls)
    .join("line")
    .attr("class", ([name]) => `wall ${wallClass(page.walls.indexOf(name))}`)
    .attr("x1", ([, at]) => line(at)[0])
    .attr("y1", ([, at]) => line(at)[1])
    .attr("x2", ([, at]) => line(at)[2])
    .attr("y2", ([, at]) => line(at)[3]);
}

/** Displacement over time, and the body beside it. @param {Motion} motion @param {Family} family @param {number} row @param {Entry | null} entry */
function drawSeries(motion, family, row, entry) {
  const svg = d3.select("#series"),
    width = sized(svg, 230),
    box = { left: 62, right: width - 58, top: 12, bottom: 188 };
  const turns = motion.span === 1 ? 2 : 1,
    begin = motion.flights[0].t[0];
  const t = d3.scaleLinear([begin, begin + turns * motion.span], [box.left, box.right]);
  const x = d3.scaleLinear(widened(extentOf(motion, "x"), 0.07), [box.bottom, box.top]);
  const inside = drawFrame(
    svg,
    box,
    { x: t, y: x },
    { x: "time in forcing periods", y: "displacement", ticks: [6, 5] },
  );
  drawWalls(group(inside, "lines"), motion, (at) => [box.left, x(at), box.right, x(at)]);
  const path = d3.pathRound(2);
  for (let turn = 0; turn < turns; turn++)
    motion.flights.forEach((flight, k) =>
      flight.t.forEach((time, i) => {
        if (turn + k + i === 0) path.moveTo(t(time), x(flight.x[i]));
        else path.lineTo(t(time + turn * motion.span), x(flight.x[i]));
      }),
    );
  group(inside, "motion")
    .selectAll("path")
    .data([path.toString()])
    .join("path")
    .attr("class", "path")
    .attr("d", (d) => d);
  const hits = d3.range(turns).flatMap((turn) =>
    motion.flights.map((flight, k) => ({
      t: flight.t[0] + turn * motion.span,
      x: flight.x[0],
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
  drawTouch(group(inside, "touches"), motion, entry, family, row, t, x);
  const bar = group(svg, "capsule"),
    middle = box.right + 30;
  bar
    .selectAll("rect")
    .data([0])
    .join("rect")
    .attr("class", "frame")
    .attr("x", middle - 14)
    .attr("y", box.top)
    .attr("width", 28)
    .attr("height", box.bottom - box.top);
  drawWalls(bar, motion, (at) => [middle - 14, x(at), middle + 14, x(at)]);
  bar
    .selectAll("text")
    .data(motion.walls)
    .join("text")
    .attr("class", ([name]) => `wall-name ${wallClass(page.walls.indexOf(name))}`)
    .attr("x", middle + 17)
    .attr("y", ([, at]) => x(at) + 4)
    .text(([name]) => name);
  svg.attr("aria-label", `Displacement over time of ${titleOf(family)}`);
  moving = { motion, scale: { t, x, px: t, pv: x } };
}

/** The touch of a grazing. @param {Selected} layer @param {Motion} motion @param {Entry | null} entry @param {Family} family @param {number} row @param {Linear} t @param {Linear} x */
function drawTouch(layer, motion, entry, family, row, t, x) {
  const wall = motion.walls.find(([name]) => name === entry?.wall),
    T = tracksOf(family)?.period[row] ?? 1;
  const touching = entry && entry.touch_time !== null && wall ? [entry.touch_time] : [];
  const begin = motion.flights[0].t[0],
    turn = Math.floor(family.times[family.starts[row]] / T);
  layer
    .selectAll("circle")
    .data(touching)
    .join("circle")
    .attr("class", "touch")
    .attr("r", 6)
    .attr("cx", (time) =>
      t(begin + ((((time / T - turn - begin) % motion.span) + motion.span) % motion.span)),
    )
    .attr("cy", x(wall ? wall[1] : 0));
}

/** @param {Motion} motion @param {Family} family @param {number} row @param {Entry | null} entry */
function drawPhase(motion, family, row, entry) {
  const svg = d3.select("#phase"),
    width = sized(svg, 230),
    box = { left: 62, right: width - 12, top: 12, bottom: 188 };
  const x = d3.scaleLinear(widened(extentOf(motion, "x"), 0.09), [box.left, box.right]);
  const v = d3.scaleLinear(widened(extentOf(motion, "v"), 0.09), [box.bottom, box.top]);
  const inside = drawFrame(svg, box, { x, y: v }, { x: "displacement", y: "velocity", ticks: [3, 5] });
  drawWalls(group(inside, "lines"), motion, (at) => [x(at), box.top, x(at), box.bottom]);
  const path = d3.pathRound(2),
    jumps = d3.pathRound(2),
    last = motion.flights[motion.flights.length - 1];
  let before = /** @type {[number, number]} */ ([last.x[last.x.length - 1], last.v[last.v.length - 1]]);
  for (const flight of motion.flights) {
    jumps.moveTo(x(before[0]), v(before[1]));
    jumps.lineTo(x(flight.x[0]), v(flight.v[0]));
    flight.x.forEach((at, i) =>
      i ? path.lineTo(x(at), v(flight.v[i])) : path.moveTo(x(at), v(flight.v[i])),
    );
    before = [flight.x[flight.x.length - 1], flight.v[flight.v.length - 1]];
  }
  const lines = [
    { name: "jump", d: jumps.toString() },
    { name: "path", d: path.toString() },
  ];
  group(inside, "motion")
    .selectAll("path")
    .data(lines)
    .join("path")
    .attr("class", ({ name }) => name)
    .attr("d", ({ d }) => d);
  const hits = motion.flights.flatMap((flight, k) => {
    const at = family.starts[row] + k,
      wall = family.walls[at];
    return [
      { name: "before", wall, x: flight.x[0], v: family.velocities[at] },
      { name: "after", wall, x: flight.x[0], v: flight.v[0] },
    ];
  });
  group(inside, "impacts")
    .selectAll("circle")
    .data(hits)
    .join("circle")
    .attr("class", (hit) => `${hit.name} ${wallClass(hit.wall)}`)
    .attr("r", 3.5)
    .attr("cx", (hit) => x(hit.x))
    .attr("cy", (hit) => v(hit.v));
  const touched = motion.walls.filter(([name]) => entry?.touch_time !== null && name === entry?.wall);
  group(inside, "touches")
    .selectAll("circle")
    .data(touched)
    .join("circle")
    .attr("class", "touch")
    .attr("r", 6)
    .attr("cx", ([, at]) => x(at))
    .attr("cy", v(0));
  svg.attr("aria-label", `Phase plane of ${titleOf(family)}`);
  if (moving) moving.scale = { ...moving.scale, px: x, pv: v };
}

/** Multipliers in the plane of complex numbers, and the unit circle. @param {[number, number][]} multipliers */
function drawCircle(multipliers) {
  const svg = d3.select("#circle"),
    width = sized(svg, 230),
    side = Math.min(width - 74, 176);
  const finite = multipliers.filter(([re, im]) => Number.isFinite(re) && Number.isFinite(im));
  const far = Math.min(EDGE, Math.max(1.25, ...finite.map(([re, im]) => 1.1 * Math.hypot(re, im))));
  const box = { left: 62, right: 62 + side, top: 12, bottom: 12 + side };
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
    shown(family.times[from + k], 12),
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
  if (entry)
    facts.push(
      ["error of the parameter", shown(entry.error, 2)],
      ["residual", shown(entry.residual, 2)],
      ["found by", entry.method],
    );
  if (entry?.opens.length) facts.push(["branches born here", entry.opens.join(", ")]);
  const { branch } = family;
  if (branch) {
    if (branch.from) facts.push(["branch born at", branch.from]);
    facts.push(["first end", branch.ends[0]], ["last end", branch.ends[1]]);
    for (const text of branch.missed) facts.push(["not located", text]);
    for (const text of branch.notes) facts.push(["note", text]);
  }
  element("orbit-numbers").replaceChildren(
    tableOf([["quantity", "value"], ...facts], "The orbit's numbers"),
    tableOf([["impact", "wall", "time", "velocity before"], ...impacts], "Impacts"),
  );
}
