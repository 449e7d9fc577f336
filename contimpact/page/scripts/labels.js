// What is written around the diagram: labels of events, names of walls, stable runs in lanes, the key.

/** The room above the frame that the labels need. @param {[number, number]} limits */
function labelRoom([low, high]) {
  const seen = hidden("labels")
    ? []
    : shownEntries().filter((entry) => low <= entry.parameters[state.x] && entry.parameters[state.x] <= high);
  const longest = d3.max(seen, (entry) => labelLength(entry.parts, orbitBehind(entry))) ?? 0;
  return longest ? Math.min(144, 30 + 5.1 * longest) : 14;
}

/** How far apart labels stand that lean to the same side: a line of text, across. */
const APART = 24;
/** How far a label may stand from its value, to either side, and how high leaders lean to it. */
const ASIDE = [0, 1, -1, 2, -2, 3, -3].map((step) => step * APART),
  FAN = 11;
/** A label's foot, and the value it belongs to. @typedef {{at: number, place: number, lean: 1 | -1, reach: number}} Leaning */

/** How a label leans: to the right, or to the left where it would leave the picture. @param {number} at @param {number} place @param {number} length @returns {Leaning} */
function leaning(at, place, length) {
  const reach = 16 + 4.4 * length,
    right = drawn.box.right + 22;
  return { at, place, reach, lean: at + reach > right ? -1 : 1 };
}

/** Whether two labels keep clear of each other, and their leaders do not cross. @param {Leaning} one @param {Leaning} other */
function clear(one, other) {
  const [left, right] = one.at < other.at ? [one, other] : [other, one],
    apart = right.at - left.at;
  const towards = left.lean > right.lean;
  return right.place >= left.place && apart >= (towards ? left.reach + right.reach : APART);
}

/** Labels of events above the frame, real ones first; those without room are counted. @param {Selected} layer */
function drawLabels(layer) {
  const { box, x } = drawn,
    taken = /** @type {Leaning[]} */ ([]);
  const wanted = hidden("labels")
    ? []
    : shownEntries()
        .flatMap((entry) => marksOf(entry).slice(0, 1))
        .map((mark) => ({ ...mark, behind: orbitBehind(mark.entry) }))
        .map((mark) => ({ ...mark, place: x(mark.x), long: labelLength(mark.entry.parts, mark.behind) }))
        .filter(({ place }) => place >= box.left && place <= box.right)
        .filter(
          (mark, k, all) =>
            !all
              .slice(0, k)
              .some(
                (one) =>
                  one.entry.label === mark.entry.label &&
                  one.behind === mark.behind &&
                  Math.abs(one.place - mark.place) < APART,
              ),
        )
        .sort((a, b) => Number(a.entry.ghost) - Number(b.entry.ghost) || a.entry.period - b.entry.period);
  const set = wanted.flatMap((label) => {
    const found = ASIDE.map((aside) => leaning(label.place + aside, label.place, label.long)).find(
      (one) =>
        one.at >= box.left &&
        one.at <= box.right &&
        (one.lean > 0 || one.at >= one.reach) &&
        taken.every((other) => clear(one, other)),
    );
    if (!found) return [];
    taken.push(found);
    return [{ ...label, ...found }];
  });
  layer
    .selectAll("line")
    .data(set)
    .join("line")
    .attr("class", "leader")
    .attr("x1", ({ place }) => place)
    .attr("x2", ({ at }) => at)
    .attr("y1", box.top)
    .attr("y2", box.top - FAN);
  layer
    .selectAll("text")
    .data(set)
    .join("text")
    .attr("class", ({ entry }) => `label${entry.ghost ? " ghost" : ""}`)
    .attr("text-anchor", ({ lean }) => (lean > 0 ? "start" : "end"))
    .attr(
      "transform",
      ({ at, lean }) => `translate(${at + 3 * lean},${box.top - FAN - 3}) rotate(${-50 * lean})`,
    )
    .each(function ({ entry, behind }) {
      writeLabel(d3.select(this), entry.parts, behind);
    });
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
  const ends = [...wallEnds].filter(([wall]) => wall >= 0).map(([wall, { y }]) => ({ wall, y }));
  layer
    .selectAll("text")
    .data(spread(ends, 16))
    .join("text")
    .attr("class", ({ wall }) => `wall-name ${wallClass(wall)}`)
    .attr("x", drawn.box.right + 5)
    .attr("y", ({ y }) => y + 4)
    .text(({ wall }) => page.walls[wall]);
}

/** Names of orbits on their stable stretches, as in pictures: where they cover no line, marker or other name. */

/** The size of a cell of the picture that something is in, and of names, in pixels. */
const CELL = 3,
  NAME_HEIGHT = 12;
/** How much a name may cover. */
const COVERED = 3;
/** @type {Set<number>} */
const covered = new Set();
/** @typedef {[number, number][]} Points */
/** @type {{name: string, points: Points}[]} */
const stretches = [];

function clearNames() {
  covered.clear();
  stretches.length = 0;
}

/** Note that something is at a place, and around it. @param {number} x @param {number} y @param {number} [around] */
function cover(x, y, around = 0) {
  const column = Math.floor(x / CELL),
    line = Math.floor(y / CELL);
  for (let i = -around; i <= around; i++)
    for (let j = -around; j <= around; j++) covered.add((line + j) * 8192 + column + i);
}

/** A part of a line that is inside the frame, as fractions. @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 @returns {[number, number]} */
function partInside(x0, y0, x1, y1) {
  const { left, right, top, bottom } = drawn.box;
  let [from, to] = [0, 1];
  for (const [start, way, low, high] of [
    [x0, x1 - x0, left, right],
    [y0, y1 - y0, top, bottom],
  ]) {
    if (way === 0) {
      if (start < low || start > high) return [1, 0];
      continue;
    }
    const [a, b] = sorted([(low - start) / way, (high - start) / way]);
    from = Math.max(from, a);
    to = Math.min(to, b);
  }
  return [from, to];
}

/** What notes the pieces of a line: all of them as covered, stable ones as stretches that can have the name. @param {string} name */
function stretchOf(name) {
  /** @type {Points | null} */
  let points = null;
  let end = [NaN, NaN];
  return (
    /** @type {number} */ x0,
    /** @type {number} */ y0,
    /** @type {number} */ x1,
    /** @type {number} */ y1,
    /** @type {number} */ status,
  ) => {
    const [from, to] = partInside(x0, y0, x1, y1),
      stable = status === 0 && from <= to;
    if (!stable || x0 !== end[0] || y0 !== end[1]) points = null;
    if (stable && !points) stretches.push({ name, points: (points = []) });
    const steps = from <= to ? Math.ceil(((to - from) * Math.hypot(x1 - x0, y1 - y0)) / CELL) : -1;
    for (let k = 0; k <= steps; k++) {
      const part = from + (k / Math.max(steps, 1)) * (to - from),
        x = x0 + part * (x1 - x0),
        y = y0 + part * (y1 - y0);
      cover(x, y);
      points?.push([x, y]);
    }
    end = [x1, y1];
  };
}

/** Places of a name along a line, and what speaks against each. @param {Points} points @param {number} number @param {number} wide */
function placesAlong(points, number, wide) {
  return [0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9].flatMap((fraction) =>
    [3, 7, 12, 19].flatMap((gap) => {
      const [x, y] = points[Math.round(fraction * (points.length - 1))],
        against = 0.3 * number + 0.05 * gap + 0.5 * Math.abs(fraction - 0.5);
      return [
        { x: x - wide / 2, y: y - gap - NAME_HEIGHT, against },
        { x: x - wide / 2, y: y + gap, against: against + 0.2 },
      ];
    }),
  );
}

/** Name each stretch once, long ones first. @param {Selected} layer */
function nameOrbits(layer) {
  const { left, right, top, bottom } = drawn.box;
  const wide = (/** @type {Points} */ points) =>
    (d3.max(points, ([x]) => x) ?? 0) - (d3.min(points, ([x]) => x) ?? 0);
  const long = stretches
    .map((stretch) => ({ ...stretch, wide: wide(stretch.points) }))
    .filter((stretch) => stretch.wide >= 4)
    .sort((a, b) => b.wide - a.wide);
  const groups = d3.groups(long, ({ name, points }) => {
    const ends = sorted([points[0][0], points[points.length - 1][0]]);
    return [name, ...ends.map((x) => Math.round(x / 4))].join();
  });
  /** @type {{name: string, x: number, y: number, wide: number}[]} */
  const set = [];
  for (const [, own] of hidden("labels") ? [] : groups) {
    const name = own[0].name.slice(0, 40),
      room = 1.24 * wordWidth(name) + 4;
    const found = own
      .flatMap(({ points }, number) => placesAlong(points, number, room))
      .filter(
        ({ x, y }) => x > left + 1 && x + room < right - 1 && y > top + 1 && y + NAME_HEIGHT < bottom - 1,
      )
      .map((place) => ({ ...place, name, wide: room, cost: place.against + coveredIn(place, room) }))
      .filter(({ x, y }) =>
        set.every((one) => x > one.x + one.wide || one.x > x + room || Math.abs(y - one.y) > NAME_HEIGHT),
      );
    const best = d3.least(found, ({ cost }) => cost);
    if (best && best.cost < COVERED) set.push(best);
  }
  layer
    .selectAll("text")
    .data(set)
    .join("text")
    .attr("class", "orbit-name")
    .attr("x", ({ x }) => x + 2)
    .attr("y", ({ y }) => y + NAME_HEIGHT - 2.5)
    .text(({ name }) => name);
}

/** How many cells with something in them a name would cover. @param {{x: number, y: number}} place @param {number} wide */
function coveredIn({ x, y }, wide) {
  let count = 0;
  for (let line = Math.floor(y / CELL); line <= (y + NAME_HEIGHT) / CELL; line++)
    for (let column = Math.floor(x / CELL); column <= (x + wide) / CELL; column++)
      if (covered.has(line * 8192 + column)) count++;
  return count;
}

/** A stretch of one orbit below the diagram; a click chooses `at`, where there is something. @typedef {{name: string, said: string, at: string, from: number, to: number}} Placed */

/** The stable runs and the attractors of no branch, or, where no branches were followed, what a simulation met. @returns {Placed[]} */
function stretchesBelow() {
  if (hidden("runs")) return [];
  if (!page.branches.length) return stretchesMet();
  return [...stableRuns(), ...simulatedAlone()];
}

/** Attractors that lie on no branch; the diagram has them at the values of the scene. @returns {Placed[]} */
function simulatedAlone() {
  return page.motions.flatMap(({ notation, branch, columns, said }) => {
    const ends = columns[state.x];
    if (branch || !ends || state.member !== page.own) return [];
    const [from, to] = sorted(ends);
    return [{ name: notation, said: `${notation}, simulated, on no branch; ${said};`, at: "", from, to }];
  });
}

/** What is known of a stable run as an attractor: its speed and its ends. @param {Run} run */
function saidOf({ branch, low, high }) {
  const middle = 0.5 * (low + high),
    known = page.motions.find((motion) => {
      const [from, to] = sorted(motion.columns[page.parameter] ?? [NaN, NaN]);
      return motion.branch === branch && from <= middle && middle <= to;
    });
  return known ? `; ${known.said};` : "";
}

/** @returns {Placed[]} */
function stableRuns() {
  return page.reading.stable.flatMap((run) => {
    const family = familyById.get(run.branch),
      column = family?.columns[state.x];
    if (!family || !column || memberOf(family) !== state.member || hidden(run.branch)) return [];
    const [from, to] = sorted(run.rows.map((row) => column[row])),
      said = `${run.notation} (${run.branch}) stable and physical${saidOf(run)}`;
    return { name: run.notation, said, at: `${run.branch}:${Math.round(d3.mean(run.rows) ?? 0)}`, from, to };
  });
}

/** Attractors that the first way of simulating has met one after the other, in the order of their values. @returns {Placed[]} */
function stretchesMet() {
  const met = shownFamilies("swept")
    .filter(({ swept }) => swept && wayOf(swept) === ways[0])
    .flatMap((family) =>
      d3.range(family.rows).map((row) => ({ family, row, x: family.columns[state.x]?.[row] ?? NaN })),
    )
    .filter(({ x }) => Number.isFinite(x))
    .sort((a, b) => a.x - b.x);
  /** @type {Placed[]} */
  const found = [];
  for (const { family, row, x } of met) {
    const last = found[found.length - 1];
    if (last?.name === family.notation) last.to = x;
    else
      found.push({
        name: family.notation,
        said: `${family.notation} was met`,
        at: `${family.id}:${row}`,
        from: x,
        to: x,
      });
  }
  return found.filter(({ from, to }) => from < to);
}

/** The same in lanes, so that those at the same values lie above each other. @returns {Placed[][]} */
function lanes() {
  /** @type {Placed[][]} */
  const found = [];
  for (const placed of stretchesBelow()) {
    const lane = found.find((own) =>
      own.every((other) => placed.to <= other.from || placed.from >= other.to),
    );
    if (lane) lane.push(placed);
    else found.push([placed]);
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
    .attr("class", (bar) => (bar.at ? "run" : "run alone"))
    .attr("x", (bar) => bar.left)
    .attr("y", (bar) => bar.top)
    .attr("width", (bar) => bar.width)
    .attr("height", LANE - 4)
    .attr("rx", 2);
  bars
    .selectAll("title")
    .data((bar) => [bar])
    .join("title")
    .text(({ said, from, to }) => `${said} for ${symbol(state.x)} from ${shown(from)} to ${shown(to)}`);
  bars.on("click", (event, { at }) => {
    event.stopPropagation();
    if (at) pick(at);
  });
  layer
    .selectAll("text")
    .data(all.filter((bar) => bar.width > 7 * bar.name.length + 4))
    .join("text")
    .attr("class", "run-name")
    .attr("text-anchor", "middle")
    .attr("x", (bar) => bar.left + bar.width / 2)
    .attr("y", (bar) => bar.top + LANE - 7)
    .text(({ name }) => name);
  layer
    .selectAll("text.axis-name")
    .data(all.length ? [0] : [])
    .join("text")
    .attr("class", "axis-name")
    .attr("x", box.left - 6)
    .attr("y", top + LANE - 7)
    .attr("text-anchor", "end")
    .attr("font-size", "11")
    .text(page.motions.length ? "range" : page.branches.length ? "stable" : "met");
}

/** @typedef {{name: string, line: string, mark: string, kind: string, ghost: boolean, at: number, row: number}} KeyItem */

const ROW = 16;

/** What styles and markers stand for, of those in sight, in rows of a width. @param {number} width @param {[number, number]} limits @returns {KeyItem[]} */
function keyItems(width, [low, high]) {
  const inSight = (/** @type {number | undefined} */ x) => x !== undefined && low <= x && x <= high;
  const used = STATUS.filter((_, status) =>
    shownFamilies("branch").some((family) => {
      const across = family.columns[state.x];
      return (
        statusShown(family, status) &&
        family.status.some(
          (own, row) =>
            own === status &&
            inSight(across?.[row]) &&
            Math.abs(across?.[row + 1] - across?.[row]) > 1e-3 * (high - low),
        )
      );
    }),
  );
  const seen = shownEntries().filter((entry) => inSight(entry.parameters[state.x])),
    kinds = [...new Set(seen.map(({ kind }) => kind))],
    ghosts = seen.some(({ ghost }) => ghost);
  const none = { line: "", mark: "", kind: "", ghost: false },
    simulated = state.y === "velocity" ? ways.filter((way) => !hidden(way)) : [];
  const items = [
    ...used.map((name) => ({ ...none, name, line: name })),
    ...(SMALL && !hidden(SMALL) ? [{ ...none, name: SMALL, line: "small" }] : []),
    ...kinds.map((kind) => ({ ...none, name: kind, kind })),
    ...(ghosts && kinds.length ? [{ ...none, name: "hollow: ghost", kind: kinds[0], ghost: true }] : []),
    ...simulated.map((name) => ({ ...none, name, mark: markPath(ways.indexOf(name), 16, 0) })),
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
      item.mark
        ? "swept nowall"
        : item.line
          ? `branch nowall ${item.line}`
          : `event nowall${item.ghost ? " ghost" : ""}`,
    )
    .attr("d", (item) => item.mark || (item.line ? "M0,0H24" : marker(item.kind, 46)))
    .attr("transform", (item) =>
      item.line || item.mark ? `translate(${x(item)},${y(item)})` : placed(item.kind, x(item) + 16, y(item)),
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
