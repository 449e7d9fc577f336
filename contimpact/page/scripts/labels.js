// What is written around the diagram: labels of events, names of walls, stable runs in lanes, the key.

/** The room above the frame that the labels need. @param {[number, number]} limits */
function labelRoom([low, high]) {
  const seen = hidden("labels")
    ? []
    : shownEntries().filter((entry) => low <= entry.parameters[state.x] && entry.parameters[state.x] <= high);
  const longest = d3.max(seen, (entry) => entry.label.length) ?? 0;
  return longest ? Math.min(140, 24 + 5.1 * Math.min(longest, 24)) : 14;
}

/** How far apart labels stand that lean to the same side: a line of text, across. */
const APART = 18;
/** @typedef {{at: number, lean: 1 | -1, reach: number}} Leaning */

/** How a label leans: to the right, or to the left where it would leave the picture. @param {number} at @param {number} length @returns {Leaning} */
function leaning(at, length) {
  const reach = 16 + 4.4 * length,
    right = drawn.box.right + 22;
  return { at, reach, lean: at + reach > right ? -1 : 1 };
}

/** Whether two labels keep clear of each other. @param {Leaning} one @param {Leaning} other */
function clear(one, other) {
  const [left, right] = one.at < other.at ? [one, other] : [other, one],
    apart = right.at - left.at;
  const towards = left.lean > right.lean;
  return apart >= (towards ? left.reach + right.reach : APART);
}

/** Labels of events above the frame, real ones first; those without room are counted. @param {Selected} layer */
function drawLabels(layer) {
  const { box, x } = drawn,
    taken = /** @type {Leaning[]} */ ([]);
  const wanted = hidden("labels")
    ? []
    : shownEntries()
        .flatMap((entry) => marksOf(entry).slice(0, 1))
        .map((mark) => ({ ...mark, text: mark.entry.label.slice(0, 24) }))
        .map((mark) => ({ ...mark, ...leaning(x(mark.x), mark.text.length) }))
        .filter(({ at }) => at >= box.left && at <= box.right)
        .sort((a, b) => Number(a.entry.ghost) - Number(b.entry.ghost) || a.entry.period - b.entry.period);
  const set = wanted.filter((label) => {
    const room = (label.lean > 0 || label.at >= label.reach) && taken.every((other) => clear(label, other));
    if (room) taken.push(label);
    return room;
  });
  layer
    .selectAll("line")
    .data(set)
    .join("line")
    .attr("class", "leader")
    .attr("x1", ({ at }) => at)
    .attr("x2", ({ at }) => at)
    .attr("y1", box.top)
    .attr("y2", box.top - 6);
  layer
    .selectAll("text")
    .data(set)
    .join("text")
    .attr("class", ({ entry }) => `label${entry.ghost ? " ghost" : ""}`)
    .attr("text-anchor", ({ lean }) => (lean > 0 ? "start" : "end"))
    .attr("transform", ({ at, lean }) => `translate(${at + 3 * lean},${box.top - 9}) rotate(${-50 * lean})`)
    .text(({ text }) => text);
  const left = wanted.length - set.length;
  element("left-out").textContent = left
    ? `no room for ${left} label${left > 1 ? "s" : ""}: zoom in, or see the table`
    : "";
}

/**
 * Where the lines of each wall leave the picture to the right, or end: those of stable orbits, if there are any.
 * @type {Map<number, {x: number, y: number, rank: number}>}
 */
const wallEnds = new Map();

/** Take a drawn piece into account. @param {number} wall @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 @param {number} status */
function noteEnd(wall, x0, y0, x1, y1, status) {
  const { box } = drawn,
    part = (box.right - x0) / (x1 - x0),
    crossing = part > 0 && part < 1;
  const [x, y] = crossing ? [box.right, y0 + part * (y1 - y0)] : [Math.max(x0, x1), x1 > x0 ? y1 : y0];
  const rank = x - 1e6 * status,
    inside = x >= box.left && x <= box.right && y > box.top && y < box.bottom;
  if (inside && rank > (wallEnds.get(wall)?.rank ?? -Infinity)) wallEnds.set(wall, { x, y, rank });
}

/** The name of each wall at the right end of its lines. @param {Selected} layer */
function drawWallNames(layer) {
  layer
    .selectAll("text")
    .data([...wallEnds].filter(([wall]) => wall >= 0))
    .join("text")
    .attr("class", ([wall]) => `wall-name ${wallClass(wall)}`)
    .attr("x", drawn.box.right + 5)
    .attr("y", ([, spot]) => spot.y + 4)
    .text(([wall]) => page.walls[wall]);
}

/** @typedef {{run: Run, from: number, to: number}} Placed */

/** The stable runs in lanes, so that those at the same values lie above each other. @returns {Placed[][]} */
function lanes() {
  /** @type {Placed[][]} */
  const found = [];
  for (const run of hidden("runs") ? [] : page.reading.stable) {
    const family = familyById.get(run.branch),
      column = family?.columns[state.x];
    if (!family || !column || memberOf(family) !== state.member || hidden(run.branch)) continue;
    const [from, to] = sorted(run.rows.map((row) => column[row]));
    const lane = found.find((placed) => placed.every((other) => to <= other.from || from >= other.to));
    if (lane) lane.push({ run, from, to });
    else found.push([{ run, from, to }]);
  }
  return found;
}

/** @param {Selected} layer @param {Placed[][]} runs */
function drawLanes(layer, runs) {
  const { box, x } = drawn,
    top = box.bottom + 44;
  const all = runs
    .flatMap((lane, k) =>
      lane.map((placed) => {
        const from = Math.max(box.left, x(placed.from)),
          to = Math.min(box.right, x(placed.to));
        return { ...placed, left: from, width: to - from, top: top + k * LANE };
      }),
    )
    .filter((bar) => bar.width > 0);
  const bars = layer
    .selectAll("rect")
    .data(all)
    .join("rect")
    .attr("class", "run")
    .attr("x", (bar) => bar.left)
    .attr("y", (bar) => bar.top)
    .attr("width", (bar) => bar.width)
    .attr("height", LANE - 4)
    .attr("rx", 2);
  bars
    .selectAll("title")
    .data((bar) => [bar])
    .join("title")
    .text(
      ({ run }) =>
        `${run.notation} (${run.branch}) stable and physical for ${symbol(page.parameter)} from ${shown(run.low)} to ${shown(run.high)}`,
    );
  bars.on("click", (event, { run }) => {
    event.stopPropagation();
    choose(`${run.branch}:${Math.round((run.rows[0] + run.rows[1]) / 2)}`);
  });
  layer
    .selectAll("text")
    .data(all.filter((bar) => bar.width > 7 * bar.run.notation.length + 4))
    .join("text")
    .attr("class", "run-name")
    .attr("text-anchor", "middle")
    .attr("x", (bar) => bar.left + bar.width / 2)
    .attr("y", (bar) => bar.top + LANE - 7)
    .text(({ run }) => run.notation);
  layer
    .selectAll("text.axis-name")
    .data(all.length ? [0] : [])
    .join("text")
    .attr("class", "axis-name")
    .attr("x", box.left - 6)
    .attr("y", top + LANE - 7)
    .attr("text-anchor", "end")
    .attr("font-size", "11")
    .text("stable");
}

/** @typedef {{name: string, line: string, kind: string, ghost: boolean, at: number, row: number}} KeyItem */

const ROW = 16;

/** What styles and markers stand for, of those in use, in rows of a width. @param {number} width @returns {KeyItem[]} */
function keyItems(width) {
  const used = STATUS.filter((_, status) =>
    shownFamilies("branch").some((f) => statusShown(f, status) && f.status.includes(status)),
  );
  const kinds = [...new Set(shownEntries().map((entry) => entry.kind))],
    ghosts = shownEntries().some((entry) => entry.ghost);
  const items = [
    ...used.map((name) => ({ name, line: name, kind: "", ghost: false })),
    ...kinds.map((kind) => ({ name: kind, line: "", kind, ghost: false })),
    ...(ghosts && kinds.length ? [{ name: "hollow: ghost", line: "", kind: kinds[0], ghost: true }] : []),
  ];
  let at = 0,
    row = 0;
  return items.map((item) => {
    const room = 36 + 7 * item.name.length;
    if (at && at + room > width) [at, row] = [0, row + 1];
    at += room;
    return { ...item, at: at - room, row };
  });
}

/** @param {Selected} layer @param {KeyItem[]} items @param {number} top */
function drawKey(layer, items, top) {
  const x = (/** @type {KeyItem} */ item) => drawn.box.left + item.at,
    y = (/** @type {KeyItem} */ item) => top + ROW * item.row;
  layer
    .selectAll("path")
    .data(items)
    .join("path")
    .attr("class", (item) =>
      item.line ? `branch nowall ${item.line}` : `event nowall${item.ghost ? " ghost" : ""}`,
    )
    .attr("d", (item) => (item.line ? "M0,0H24" : marker(item.kind, 46)))
    .attr("transform", (item) =>
      item.line ? `translate(${x(item)},${y(item)})` : placed(item.kind, x(item) + 16, y(item)),
    );
  layer
    .selectAll("text")
    .data(items)
    .join("text")
    .attr("class", "label")
    .attr("x", (item) => x(item) + 28)
    .attr("y", (item) => y(item) + 4)
    .text((item) => item.name);
}
