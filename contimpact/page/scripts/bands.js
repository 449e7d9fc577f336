// Basin fractions below the diagram: what part of random starts leads to each motion, as stacked bands.

const BANDS = 70,
  BAND_GAP = 16;

/** The height that the bands take. */
function bandsHeight() {
  return page.fractions?.columns[state.x] && !hidden("runs") ? BANDS + BAND_GAP : 0;
}

/** @param {Selected} layer @param {number} top */
function drawBands(layer, top) {
  layer.selectAll("*").remove();
  const across = page.fractions?.columns[state.x];
  if (!page.fractions || !across || !bandsHeight()) return;
  const { box, x } = drawn,
    y = d3.scaleLinear([0, 1], [top + BANDS, top]),
    under = across.map(() => 0);
  const clip = layer.append("clipPath").attr("id", "bands-clip").append("rect");
  clip
    .attr("x", box.left)
    .attr("width", box.right - box.left)
    .attr("y", top)
    .attr("height", BANDS);
  const inside = layer.append("g").attr("clip-path", "url(#bands-clip)");
  page.fractions.motions.forEach(({ name, parts, low, high }, k) => {
    const from = [...under],
      corners = (/** @type {number[]} */ heights) =>
        heights.map((height, i) => /** @type {[number, number]} */ ([x(across[i]), y(height)])),
      over = parts.map((part, i) => from[i] + part),
      outline = d3.line()([...corners(over), ...corners(from).reverse()]);
    inside
      .append("path")
      .attr("class", `band band${k % 6}`)
      .attr("d", outline ?? "")
      .append("title")
      .text(
        across
          .map(
            (value, i) =>
              `${shown(value, 6)}: ${percent(parts[i])} (${percent(low[i])} to ${percent(high[i])})`,
          )
          .reduce((text, line) => `${text}\n${line}`, `${name} at ${symbol(state.x)} =`),
      );
    const half = 3.2 * name.length + 3,
      left = Math.max(box.left, d3.min(across, x) ?? 0) + half,
      right = Math.min(box.right, d3.max(across, x) ?? 0) - half;
    const places = d3.range(0, across.length - 0.5, 0.5),
      at = (/** @type {number} */ i) => x(between(across, i));
    const inSight = places.filter((i) => at(i) >= left && at(i) <= right),
      most = d3.max(inSight, (i) => between(parts, i)) ?? 0,
      wide = inSight.filter((i) => between(parts, i) > 0.9 * most),
      widest = wide[wide.length >> 1];
    if (widest !== undefined && between(parts, widest) * BANDS > 13)
      layer
        .append("text")
        .attr("class", "run-name")
        .attr("text-anchor", "middle")
        .attr("x", at(widest))
        .attr("y", y(between(from, widest) + 0.5 * between(parts, widest)) + 4)
        .text(name);
    over.forEach((height, i) => (under[i] = height));
  });
  layer
    .append("rect")
    .attr("class", "frame")
    .attr("x", box.left)
    .attr("width", box.right - box.left)
    .attr("y", top)
    .attr("height", BANDS);
  for (const [part, name] of /** @type {[number, string][]} */ ([
    [0, percent(0)],
    [0.5, "starts"],
    [1, percent(1)],
  ]))
    layer
      .append("text")
      .attr("class", "axis-name")
      .attr("text-anchor", "end")
      .attr("font-size", "11")
      .attr("x", box.left - 6)
      .attr("y", y(part) + 9 * part)
      .text(name);
}

/** A number at a place, or half way between two. @param {number[]} numbers @param {number} place */
function between(numbers, place) {
  return 0.5 * (numbers[Math.floor(place)] + numbers[Math.ceil(place)]);
}

/** @param {number} part */
function percent(part) {
  return `${shown(100 * part, 3)} %`;
}
