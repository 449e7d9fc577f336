// Curves of bifurcations in two parameters; a click opens the diagram at the nearest value that was computed.

const plane = d3.select("#plane");
/** @type {{box: Box, limits: Limits, x: Linear, y: Linear}} */
let planeDrawn = { ...drawn };

/** @type {{curve: Curve, columns: Record<string, Numbers>, ghost: Numbers, made: Record<string, Numbers>}[]} */
const curves = page.curves.map((curve) => ({
  curve,
  columns: unpackedAll(curve.columns, curve.rows),
  ghost: unpacked(curve.ghost, curve.rows),
  made: {},
}));

const dark = matchMedia("screen and (prefers-color-scheme: dark)");

/** A colour of pictures as it is drawn: lighter on dark. @param {string | undefined} colour */
function ink(colour) {
  const own = colour ?? "#808080",
    { h, s, l } = d3.hsl(own);
  return dark.matches ? d3.hsl(h, s, 1 - 0.65 * l).formatHex() : own;
}

/** The colour of what ends an orbit. @param {string | null} label @param {string} notation */
function colourOf(label, notation) {
  return ink(page.keys.find((key) => key.label === label && key.notation === notation)?.colour);
}

/** The bifurcations of a panel's curves, and what stands behind their labels. @param {Panel} panel */
function keysOf(panel) {
  const own = page.keys.filter((_, place) => panel.curves.some((curve) => page.curves[curve].key === place)),
    several = new Set(own.map(({ notation }) => notation)).size > 1;
  return own.map((key) => ({ ...key, behind: several && !key.parts.above ? `(${key.notation})` : "" }));
}

/** Items of a key in rows. @template {{long: number}} I @param {I[]} items @param {number} left @param {number} right @returns {(I & {at: number, row: number})[]} */
function inRows(items, left, right) {
  let at = left,
    row = 0;
  return items.map((item) => {
    const room = 46 + 6.6 * item.long;
    if (at > left && at + room > right) [at, row] = [left, row + 1];
    at += room;
    return { ...item, at: at - room, row };
  });
}

/** The members of the diagram that belong to a panel, with their value of the second parameter. @param {Panel} panel */
function computedIn(panel) {
  return page.members
    .map((member, place) => ({
      place,
      value: member.fixed[panel.across],
      fixed: member.fixed,
    }))
    .filter(
      ({ value, fixed }) =>
        value !== undefined &&
        Object.entries(panel.fixed).every(([name, own]) => (fixed[name] ?? page.fixed[name]) === own),
    );
}

/** @returns {Limits} */
function planeHome() {
  const panel = page.panels[state.panel],
    own = panel.curves.map((place) => curves[place].columns);
  const extent = (/** @type {string} */ name) =>
    widened(
      [
        d3.min(own, (columns) => d3.min(columns[name])) ?? 0,
        d3.max(own, (columns) => d3.max(columns[name])) ?? 1,
      ],
      0.04,
    );
  return { x: extent(panel.across), y: extent(panel.along) };
}

/** Draw the view of curves. */
function drawPlane() {
  const panel = page.panels[state.panel];
  if (!panel) return;
  const keys = keysOf(panel),
    names = d3.max(keys, ({ parts, behind }) => labelLength(parts, behind)) ?? 0,
    wide = Math.max(200, element("plane").parentElement?.clientWidth ?? 600),
    given = state.plane,
    box = {
      left: leftRoom(given ? [given[2], given[3]] : planeHome().y, 6),
      right: wide - 14 - 6 * names,
      top: 16,
      bottom: 430,
    },
    lines = curveKey(panel, keys, box.left, wide),
    tints = areaKey(panel, box.left, wide),
    below = box.bottom + 70,
    rowsOf = (/** @type {{row: number}[]} */ items) => (d3.max(items, ({ row }) => row) ?? -1) + 1;
  const lower = below + KEY_ROW * rowsOf(lines);
  sized(plane, lower + KEY_ROW * rowsOf(tints));
  /** @type {Limits} */
  const limits = given ? { x: [given[0], given[1]], y: [given[2], given[3]] } : planeHome();
  const x = d3.scaleLinear(limits.x, [box.left, box.right]),
    y = d3.scaleLinear(limits.y, [box.bottom, box.top]);
  planeDrawn = { box, limits, x, y };
  const inside = drawFrame(plane, box, { x, y }, { x: withUnit(panel.across), y: withUnit(panel.along) });
  drawAreas(group(inside, "areas"), panel);
  drawRegions(group(inside, "regions"), panel);
  drawCurves(group(inside, "curves"), panel);
  drawPoints(group(inside, "points"), panel);
  group(inside, "pointer");
  drawComputed(group(plane, "values"), panel);
  nameEnds(group(plane, "ends"), panel, keys);
  drawCurveKey(group(plane, "key"), lines, below);
  drawAreaKey(group(plane, "tints"), tints, lower);
  plane.attr(
    "aria-label",
    `Curves of bifurcations: ${withUnit(panel.along)} against ${withUnit(panel.across)}, ${valuesText(panel.fixed)}`,
  );
}

/** @param {Selected} layer @param {Panel} panel */
function drawCurves(layer, panel) {
  const lines = panel.curves
    .flatMap((place) => {
      const { curve, columns, ghost, made } = curves[place],
        pens = [d3.pathRound(2), d3.pathRound(2)];
      const slope = (/** @type {string} */ name) => (made[name] ??= slopes(columns.arclength, columns[name]));
      draw(
        {
          length: columns.arclength,
          x: columns[panel.across],
          y: columns[panel.along],
          dx: slope(panel.across),
          dy: slope(panel.along),
          status: ghost,
        },
        planeDrawn,
        pens,
      );
      return pens.map((pen, status) => ({
        curve,
        d: pen.toString(),
        name: status ? "ghost" : "",
        colour: ink(page.keys[curve.key].colour),
      }));
    })
    .filter(({ d }) => d);
  layer
    .selectAll("path")
    .data(lines)
    .join("path")
    .attr("class", ({ name }) => `curve ${name}`)
    .attr("stroke", ({ colour }) => colour)
    .attr("data-curve", ({ curve }) => curve.id)
    .attr("d", ({ d }) => d);
}

/** Points of codimension two, with their kinds. @param {Selected} layer @param {Panel} panel */
function drawPoints(layer, panel) {
  const all = panel.curves
    .flatMap((place) => curves[place].curve.points)
    .map((point) => ({
      ...point,
      x: planeDrawn.x(point.parameters[panel.across]),
      y: planeDrawn.y(point.parameters[panel.along]),
    }));
  // a crossing of two curves is found on each of them
  const points = all.filter((point, k) =>
    all.slice(0, k).every((other) => Math.hypot(other.x - point.x, other.y - point.y) > 3),
  );
  const dots = layer
    .selectAll("circle")
    .data(points)
    .join("circle")
    .attr("class", "point")
    .attr("r", 4.5)
    .attr("cx", ({ x }) => x)
    .attr("cy", ({ y }) => y);
  dots
    .selectAll("title")
    .data((point) => [point])
    .join("title")
    .text(({ kind, changes }) => `${kind}: ${changes}`);
  layer
    .selectAll("text")
    .data(beside(points))
    .join("text")
    .attr("class", "label")
    .attr("x", ({ left }) => left)
    .attr("y", ({ top }) => top + 10)
    .text(({ kind }) => kind);
}

/** Labels of points where they cover no other one and no point; those without such a place are left to their titles.
 * @template {{x: number, y: number, kind: string}} P @param {P[]} points */
function beside(points) {
  const { box } = planeDrawn;
  /** @type {(P & {left: number, top: number, wide: number})[]} */
  const set = [];
  for (const point of points) {
    const wide = 7 * point.kind.length + 2;
    const spots = [
      [7, -15],
      [7, 3],
      [-7 - wide, -15],
      [-7 - wide, 3],
      [-wide / 2, -20],
      [-wide / 2, 8],
    ].map(([dx, dy]) => ({ left: point.x + dx, top: point.y + dy }));
    const free = spots.find(
      ({ left, top }) =>
        left > box.left &&
        left + wide < box.right &&
        top > box.top &&
        top + 13 < box.bottom &&
        set.every(
          (one) => left > one.left + one.wide || one.left > left + wide || Math.abs(top - one.top) > 13,
        ) &&
        points.every(({ x, y }) => x < left - 5 || x > left + wide + 5 || y < top - 5 || y > top + 18),
    );
    if (free) set.push({ ...point, ...free, wide });
  }
  return set;
}

/** Name curves where they leave the picture to the right, as in pictures. @param {Selected} layer @param {Panel} panel @param {ReturnType<typeof keysOf>} keys */
function nameEnds(layer, panel, keys) {
  const { x, y, box } = planeDrawn,
    high = x.invert(box.right),
    near = x.invert(box.right - 0.06 * (box.right - box.left));
  const ends = panel.curves.flatMap((place) => {
    const { curve, columns } = curves[place],
      across = columns[panel.across],
      along = columns[panel.along],
      key = keys.find(({ label, notation }) => label === curve.label && notation === curve.notation);
    const found = [];
    for (let row = 0; row + 1 < curve.rows; row++)
      if ((across[row] - high) * (across[row + 1] - high) <= 0) found.push(along[row]);
    const last = d3.maxIndex(/** @type {any} */ (across));
    if (!found.length && across[last] > near && across[last] <= high) found.push(along[last]);
    return found.map((value) => ({ key, y: y(value) }));
  });
  const seen = ends.filter(({ y: at }) => at >= box.top && at <= box.bottom);
  const once = d3.groups(seen, ({ key, y: at }) => `${key?.label} ${key?.notation} ${Math.round(at / 6)}`);
  layer
    .selectAll("text")
    .data(
      spread(
        once.map(([, [first]]) => first),
        19,
        box.bottom,
      ),
    )
    .join("text")
    .attr("class", "curve-name")
    .attr("fill", ({ key }) => ink(key?.colour))
    .attr("x", box.right + 6)
    .attr("y", ({ y: at }) => at + 4)
    .each(function ({ key }) {
      if (key) writeLabel(d3.select(this), key.parts, key.behind);
    });
}

/** What comes first, as bands along the lower edge, where no areas tell more. @param {Selected} layer @param {Panel} panel */
function drawRegions(layer, panel) {
  const { x, box } = planeDrawn;
  const bands = (panel.areas.length ? [] : panel.regions).map((region) => ({
    region,
    colour: colourOf(region.first, region.notation),
    lane: region.lane,
  }));
  const rects = layer
    .selectAll("rect")
    .data(bands)
    .join("rect")
    .attr("class", ({ region }) => `region${region.said ? " unchecked" : ""}`)
    .attr("x", ({ region }) => x(region.low))
    .attr("width", ({ region }) => Math.max(0, x(region.high) - x(region.low)))
    .attr("y", ({ lane }) => box.bottom - 13 - 14 * lane)
    .attr("height", 12)
    .attr("fill", ({ colour }) => colour);
  rects
    .selectAll("title")
    .data((band) => [band])
    .join("title")
    .text(
      ({ region }) =>
        `${region.notation}${region.branch ? ` (${region.branch})` : ""}: ${region.first} first from ${shown(region.low, 6)} to ${shown(region.high, 6)}${region.said ? ` (${region.said})` : ""}`,
    );
}

/** Values at which branches were computed, below the axis, and as buttons. @param {Selected} layer @param {Panel} panel */
function drawComputed(layer, panel) {
  const { x, box } = planeDrawn,
    values = computedIn(panel);
  layer
    .selectAll("path")
    .data(values.filter(({ value }) => x(value) >= box.left && x(value) <= box.right))
    .join("path")
    .attr("class", ({ place }) => `computed${place === state.member ? " here" : ""}`)
    .attr("d", d3.symbol(d3.symbolTriangle, 50)())
    .attr("transform", ({ value }) => `translate(${x(value)},${box.bottom + 47})`);
  const buttons = values.map(({ place, value }) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `${symbol(panel.across)} = ${ofPi(value)}`;
    button.addEventListener("click", () => openMember(place));
    return button;
  });
  element("plane-diagrams").replaceChildren(...(values.length ? ["diagrams at", ...buttons] : []));
}

const KEY_ROW = 19;

/** The key to the lines of a panel, in rows. @param {Panel} panel @param {ReturnType<typeof keysOf>} keys @param {number} left @param {number} right */
function curveKey(panel, keys, left, right) {
  const items = keys.map(({ parts, behind, colour }) => ({
    parts,
    behind,
    colour: ink(colour),
    name: "",
    long: labelLength(parts, behind),
  }));
  if (panel.curves.some((place) => curves[place].ghost.some(Boolean)))
    items.push({
      parts: { symbol: "ghost", tilde: false, below: "", above: "" },
      behind: "",
      colour: ink("#000000"),
      name: "ghost",
      long: 5,
    });
  return inRows(items, left, right);
}

/** @param {Selected} layer @param {ReturnType<typeof curveKey>} items @param {number} top */
function drawCurveKey(layer, items, top) {
  layer
    .selectAll("path")
    .data(items)
    .join("path")
    .attr("class", ({ name }) => `curve ${name}`)
    .attr("stroke", ({ colour }) => colour)
    .attr("d", "M0,0H24")
    .attr("transform", ({ at, row }) => `translate(${at},${top + KEY_ROW * row})`);
  layer
    .selectAll("text")
    .data(items)
    .join("text")
    .attr("class", "label")
    .attr("x", ({ at }) => at + 29)
    .attr("y", ({ row }) => top + 4 + KEY_ROW * row)
    .each(function ({ parts, behind }) {
      writeLabel(d3.select(this), parts, behind);
    });
}

/** The tables of points of codimension two and of areas. */
function drawPlaneTables() {
  const panel = page.panels[state.panel];
  const all = (panel?.curves ?? []).flatMap((place) =>
    page.curves[place].points.map((point) => ({ ...point, on: page.curves[place].label })),
  );
  // a point of two curves is found on each of them, its place to rounding
  const found = d3.groups(all, ({ parameters }) =>
    [panel.across, panel.along].map((name) => parameters[name]?.toPrecision(6)).join(" "),
  );
  const once = (/** @type {string[]} */ texts, /** @type {string} */ between) =>
    [...new Set(texts)].join(between);
  const rows = found.map(([, own]) => [
    once(
      own.map(({ kind }) => kind),
      ", ",
    ),
    once(
      own.map(({ on }) => on),
      ", ",
    ),
    shown(own[0].parameters[panel.across]),
    shown(own[0].parameters[panel.along]),
    once(
      own.map(({ changes }) => changes),
      "; ",
    ),
  ]);
  const head = ["point", "on", withUnit(panel?.across ?? ""), withUnit(panel?.along ?? ""), "what changes"];
  const areas = panel ? areaRows(panel) : [],
    areaHead = ["area", "stable orbits", "of the rectangle", "doubts"];
  element("plane-points").replaceChildren(
    ...(rows.length ? [tableOf([head, ...rows], "Points of codimension two")] : []),
    ...(areas.length ? [tableOf([areaHead, ...areas], "Areas")] : []),
  );
}

/** Open the diagram of a member. @param {number} member */
function openMember(member) {
  const at = placeOf(state.at),
    kept = at && memberOf(at.family) === member;
  change({
    view: "diagram",
    member,
    xlim: null,
    ylim: null,
    at: kept ? state.at : opening(member),
  });
}

/** The curve's point nearest to a place. @param {number} px @param {number} py */
function nearestOnCurves(px, py) {
  const panel = page.panels[state.panel];
  let found = null,
    least = NEAREST;
  for (const place of panel.curves) {
    const { curve, columns, ghost } = curves[place];
    for (let row = 0; row < curve.rows; row++) {
      const x = planeDrawn.x(columns[panel.across][row]),
        y = planeDrawn.y(columns[panel.along][row]),
        apartBy = Math.hypot(x - px, y - py);
      if (apartBy < least) [found, least] = [{ curve, row, x, y, ghost: ghost[row], columns }, apartBy];
    }
  }
  return found;
}

/** The member whose value is nearest to a place. @param {number} px */
function nearestComputed(px) {
  const values = computedIn(page.panels[state.panel]),
    wanted = planeDrawn.x.invert(px);
  return d3.least(values, ({ value }) => Math.abs(value - wanted));
}

/** What is said of a place: the curve there, and what a click opens. @param {number} px @param {number} py */
function planeText(px, py) {
  const panel = page.panels[state.panel],
    found = nearestOnCurves(px, py),
    member = nearestComputed(px),
    lines = [];
  if (found) {
    const { curve, columns, row, ghost } = found;
    const names = [...new Set([panel.across, panel.along, ...curve.parameters])];
    lines.push(`${curve.label} of ${curve.notation}, ${curve.id}${ghost ? ", ghost" : ""}`);
    lines.push(...names.map((name) => `${symbol(name)} = ${shown(columns[name]?.[row])}`));
  }
  const area = areaAt(panel, planeDrawn.x.invert(px), planeDrawn.y.invert(py));
  if (area) lines.push(`${area.id}: ${area.says}`);
  if (member) lines.push(`click: the diagram at ${symbol(panel.across)} = ${ofPi(member.value)}`);
  return { found, text: lines.join(" \u00b7 ") };
}

plane
  .on("pointermove", (event) => {
    const [px, py] = d3.pointer(event, plane.node()),
      { box } = planeDrawn;
    const inside = px >= box.left && px <= box.right && py >= box.top && py <= box.bottom;
    const { found, text } = inside && !event.buttons ? planeText(px, py) : { found: null, text: "" };
    group(group(plane, "inside"), "pointer")
      .selectAll("circle")
      .data(found ? [found] : [])
      .join("circle")
      .attr("class", "pointed")
      .attr("r", 6)
      .attr("cx", (spot) => spot.x)
      .attr("cy", (spot) => spot.y);
    showHover("plane-hover", "plane-help", text);
  })
  .on("pointerleave", () => showHover("plane-hover", "plane-help", ""))
  .on("click", (event) => {
    if (event.defaultPrevented || event.shiftKey) return;
    const member = nearestComputed(d3.pointer(event, plane.node())[0]);
    if (member) openMember(member.place);
  });

const zoomPlane = (/** @type {Limits} */ limits) => change({ plane: [...limits.x, ...limits.y] });
if (page.curves.length) zoomable(plane, () => planeDrawn, zoomPlane);
element("plane-in").addEventListener("click", () => zoomPlane(scaled(planeDrawn.limits, 0.5)));
element("plane-out").addEventListener("click", () => zoomPlane(scaled(planeDrawn.limits, 2)));
element("plane-all").addEventListener("click", () => change({ plane: null }));
element("panel").addEventListener("change", (event) =>
  change({
    panel: Number(/** @type {HTMLSelectElement} */ (event.target).value),
    plane: null,
  }),
);
