// Axes, zoom and export, for every picture of the page.

d3.formatDefaultLocale({ decimal: ".", thousands: "", grouping: [3], currency: ["", ""] });

/** @typedef {d3.ScaleLinear<number, number>} Linear */
/** @typedef {{left: number, right: number, top: number, bottom: number}} Box */
/** @typedef {d3.Selection<any, any, any, any>} Selected */

/**
 * The group of a class in a parent, made when it is first asked for.
 * @param {Selected} parent
 * @param {string} name
 * @returns {Selected}
 */
function group(parent, name) {
  return parent
    .selectAll(`:scope > g.${name}`)
    .data([0])
    .join((enter) => enter.append("g").attr("class", name));
}

/**
 * Draw frame and axes with their names, and clip what is inside.
 * @param {Selected} svg
 * @param {Box} box
 * @param {{x: Linear, y: Linear}} scale
 * @param {{x: string, y: string, ticks?: [number, number]}} names
 */
function drawFrame(svg, box, scale, names) {
  const frame = group(svg, "frames"),
    [nx, ny] = names.ticks ?? [8, 6];
  const axis = (/** @type {string} */ name, /** @type {any} */ draws, /** @type {string} */ at) =>
    group(frame, name)
      .classed("axis", true)
      .attr("transform", at)
      .call(draws)
      .attr("font-size", null)
      .attr("font-family", null);
  axis("below", d3.axisBottom(scale.x).ticks(nx).tickSizeOuter(0), `translate(0,${box.bottom})`);
  axis("beside", d3.axisLeft(scale.y).ticks(ny).tickSizeOuter(0), `translate(${box.left},0)`);
  frame
    .selectAll("rect.frame")
    .data([0])
    .join("rect")
    .attr("class", "frame")
    .attr("x", box.left)
    .attr("y", box.top)
    .attr("width", Math.max(0, box.right - box.left))
    .attr("height", Math.max(0, box.bottom - box.top));
  frame
    .selectAll("text.axis-name")
    .data([names.x, names.y])
    .join("text")
    .attr("class", "axis-name")
    .attr("text-anchor", "middle")
    .text((name) => name)
    .attr("transform", (_, k) =>
      k === 0
        ? `translate(${(box.left + box.right) / 2},${box.bottom + 34})`
        : `translate(13,${(box.top + box.bottom) / 2}) rotate(-90)`,
    );
  const id = `clip-${svg.attr("id")}`;
  svg
    .selectAll("clipPath")
    .data([0])
    .join("clipPath")
    .attr("id", id)
    .selectAll("rect")
    .data([0])
    .join("rect")
    .attr("x", box.left)
    .attr("y", box.top)
    .attr("width", Math.max(0, box.right - box.left))
    .attr("height", Math.max(0, box.bottom - box.top));
  return group(svg, "inside").attr("clip-path", `url(#${id})`);
}

/**
 * Give a picture its size; returns its width.
 * @param {Selected} svg
 * @param {number} height
 */
function sized(svg, height) {
  const width = Math.max(200, Math.round(svg.node().parentElement.clientWidth) || 600);
  svg.attr("viewBox", `0 0 ${width} ${height}`).attr("height", height).attr("width", width);
  return width;
}

/** The room left of a frame: for the numbers of its axis, and what is drawn. @param {[number, number]} limits @param {number} ticks */
function leftRoom(limits, ticks) {
  const scale = d3.scaleLinear(limits, [0, 1]),
    widths = scale.ticks(ticks).map((value) => wordWidth(scale.tickFormat(ticks)(value)));
  return Math.max(50, 30 + (12 / 8.5) * (d3.max(widths) ?? 0));
}

/** Names beside an axis, so far apart that they can be read, above a lower edge. @template {{y: number}} N @param {N[]} names @param {number} apart @param {number} [edge] */
function spread(names, apart, edge = Infinity) {
  const found = names.map((name) => ({ ...name })).sort((one, other) => one.y - other.y);
  found.forEach((name, k) => {
    if (k) name.y = Math.max(name.y, found[k - 1].y + apart);
  });
  let below = edge + apart;
  for (const name of found.reverse()) {
    name.y = Math.min(name.y, below - apart);
    below = name.y;
  }
  return found;
}

/** @typedef {{x: [number, number], y: [number, number]}} Limits */

/**
 * Zoom by wheel, pinch and dragging; Shift and dragging chooses a box, the wheel over an axis scales it alone.
 * @param {Selected} svg
 * @param {() => {box: Box, limits: Limits}} view
 * @param {(limits: Limits) => void} set
 */
function zoomable(svg, view, set) {
  /** @type {{box: Box, limits: Limits} | null} */
  let base = null;
  const zoom = d3
    .zoom()
    .scaleExtent([1e-9, 1e9])
    .filter((event) => !event.shiftKey && !event.button)
    .on("start", () => {
      base = view();
    })
    .on("zoom", (event) => {
      if (!base || !event.sourceEvent) return;
      const { box, limits } = base;
      const before = {
        x: d3.scaleLinear(limits.x, [box.left, box.right]),
        y: d3.scaleLinear(limits.y, [box.bottom, box.top]),
      };
      const x = event.transform.rescaleX(before.x).domain(),
        y = event.transform.rescaleY(before.y).domain();
      const [px, py] =
        event.sourceEvent.type === "wheel" ? d3.pointer(event.sourceEvent, svg.node()) : [NaN, NaN];
      set(
        limited(
          {
            x: px < box.left ? limits.x : x,
            y: py > box.bottom ? limits.y : y,
          },
          limits,
        ),
      );
    })
    .on("end", () => {
      svg.property("__zoom", d3.zoomIdentity);
    });
  svg.call(/** @type {any} */ (zoom)).on("dblclick.zoom", null);
  boxed(svg, view, set);
}

/**
 * Limits that a number can still tell apart, or those before.
 * @param {Limits} wanted
 * @param {Limits} before
 */
function limited(wanted, before) {
  const fine = (/** @type {[number, number]} */ pair) =>
    pair[1] - pair[0] > 1e-12 * Math.max(...pair.map(Math.abs));
  return fine(wanted.x) && fine(wanted.y) ? wanted : before;
}

/**
 * Shift and dragging: the box becomes the view.
 * @param {Selected} svg
 * @param {() => {box: Box, limits: Limits}} view
 * @param {(limits: Limits) => void} set
 */
function boxed(svg, view, set) {
  svg.on("pointerdown.box", (event) => {
    if (!event.shiftKey || event.button) return;
    event.preventDefault();
    const from = d3.pointer(event, svg.node()),
      mark = svg.append("rect").attr("class", "box");
    const corners = (/** @type {any} */ moved) => {
      const to = d3.pointer(moved, svg.node());
      return { x: sorted([from[0], to[0]]), y: sorted([from[1], to[1]]) };
    };
    d3.select(window)
      .on("pointermove.box", (moved) => {
        const { x, y } = corners(moved);
        mark
          .attr("x", x[0])
          .attr("y", y[0])
          .attr("width", x[1] - x[0])
          .attr("height", y[1] - y[0]);
      })
      .on("pointerup.box", (moved) => {
        d3.select(window).on(".box", null);
        mark.remove();
        const { x, y } = corners(moved),
          { box, limits } = view();
        if (x[1] - x[0] < 4 || y[1] - y[0] < 4) return;
        const across = d3.scaleLinear([box.left, box.right], limits.x),
          up = d3.scaleLinear([box.bottom, box.top], limits.y);
        set(limited({ x: [across(x[0]), across(x[1])], y: [up(y[1]), up(y[0])] }, limits));
      });
  });
}

/**
 * Limits scaled about a point, which keeps its place, or about their middle.
 * @param {Limits} limits
 * @param {number} factor
 * @param {number[]} [about]
 * @returns {Limits}
 */
function scaled(limits, factor, about) {
  const one = (/** @type {[number, number]} */ [low, high], fixed = (low + high) / 2) => {
    const inside = low <= fixed && fixed <= high,
      below = inside ? fixed - low : (high - low) / 2,
      above = inside ? high - fixed : below;
    return /** @type {[number, number]} */ ([fixed - factor * below, fixed + factor * above]);
  };
  return { x: one(limits.x, about?.[0]), y: one(limits.y, about?.[1]) };
}

/**
 * Limits with a margin.
 * @param {number[]} extent
 * @param {number} part
 * @returns {[number, number]}
 */
function widened([low, high], part) {
  const margin = part * (high - low || Math.abs(low) || 1);
  return [low - margin, high + margin];
}

const LOOKS = [
  "fill",
  "fill-opacity",
  "stroke",
  "stroke-width",
  "stroke-dasharray",
  "stroke-linejoin",
  "opacity",
  "font-size",
  "font-family",
  "font-weight",
  "font-style",
  "text-anchor",
];

/**
 * A picture as an SVG file that needs no style sheet.
 * @param {string} id
 */
function svgText(id) {
  const shownNow = element(id),
    copy = /** @type {SVGElement} */ (shownNow.cloneNode(true));
  const own = [shownNow, ...shownNow.querySelectorAll("*")],
    copies = [copy, ...copy.querySelectorAll("*")];
  own.forEach((node, k) => {
    const look = getComputedStyle(node);
    for (const name of LOOKS) copies[k].setAttribute(name, look.getPropertyValue(name));
    for (const name of ["class", "tabindex", "role", "style"]) copies[k].removeAttribute(name);
  });
  const { width, height } = /** @type {any} */ (shownNow).viewBox.baseVal;
  const paper = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  for (const [name, value] of [
    ["width", width],
    ["height", height],
  ])
    paper.setAttribute(name, value);
  paper.setAttribute("fill", getComputedStyle(document.body).backgroundColor);
  copy.insertBefore(paper, copy.firstChild);
  for (const [name, value] of [
    ["width", width],
    ["height", height],
  ])
    copy.setAttribute(name, value);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(copy)}\n`;
}
