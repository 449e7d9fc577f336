// Areas of two parameters in which the same stable orbits end in the same way, tinted under the curves.

/** @typedef {{text: string, look: {colour: string | null, name: string}, several: boolean}} Tint */

/** The key to the tint of an area: what ends its first orbit. @param {Panel} panel @param {Area} area @returns {Tint} */
function tintOf(panel, area) {
  const [orbit] = area.orbits,
    several = new Set(panel.areas.flatMap(({ orbits }) => orbits.map(({ notation }) => notation))).size > 1,
    curve = page.curves.find((one) => one.label === orbit.ends && one.notation === orbit.notation);
  return {
    text:
      (orbit.ends ? `stable until ${orbit.ends}` : "stable throughout") +
      (several ? ` (${orbit.notation})` : ""),
    look: orbit.ends
      ? curve
        ? lookOf(keyOf(curve))
        : { colour: null, name: "further" }
      : { colour: null, name: "throughout" },
    several: area.orbits.length > 1,
  };
}

/** Crossed lines over areas with several stable orbits. */
function drawCrosses() {
  plane
    .selectAll("pattern")
    .data([0])
    .join("pattern")
    .attr("id", "crosses")
    .attr("width", 7)
    .attr("height", 7)
    .attr("patternUnits", "userSpaceOnUse")
    .selectAll("path")
    .data([0])
    .join("path")
    .attr("class", "crosses")
    .attr("d", "M0,0L7,7M7,0L0,7");
}

/** @param {Selected} layer @param {Panel} panel */
function drawAreas(layer, panel) {
  const { x, y } = planeDrawn,
    pen = d3.line(
      ([across]) => x(across),
      ([, along]) => y(along),
    );
  const shapes = panel.areas.flatMap((area) => {
    const tint = tintOf(panel, area),
      shape = { area, d: area.polygon.map((ring) => `${pen(ring)}Z`).join("") };
    const tinted = { ...shape, name: `area ${tint.look.name}`, fill: tint.look.colour };
    return tint.several ? [tinted, { ...shape, name: "", fill: "url(#crosses)" }] : [tinted];
  });
  if (panel.areas.some(({ orbits }) => orbits.length > 1)) drawCrosses();
  layer
    .selectAll("path")
    .data(shapes)
    .join("path")
    .attr("class", ({ name }) => name)
    .attr("fill", ({ fill }) => fill)
    .attr("fill-rule", "evenodd")
    .attr("data-area", ({ area }) => area.id)
    .attr("d", ({ d }) => d);
}

/** The keys to the tints, each once, below those to the curves; returns the lines they take.
 * @param {Selected} layer @param {Panel} panel @param {number} top */
function drawAreaKey(layer, panel, top) {
  const { box } = planeDrawn,
    tints = new Map(panel.areas.map((area) => [tintOf(panel, area).text, tintOf(panel, area)]));
  const keys = [...tints].map(([text, { look }]) => ({ text, name: `area ${look.name}`, fill: look.colour }));
  if (panel.areas.some(({ orbits }) => orbits.length > 1))
    keys.push({ text: "several stable orbits", name: "", fill: "url(#crosses)" });
  let at = box.left,
    line = 0;
  const items = keys.map((key) => {
    const width = 40 + 6.4 * key.text.length;
    if (at > box.left && at + width > box.right) [at, line] = [box.left, line + 1];
    const item = { ...key, x: at, y: top + 20 * line };
    at += width;
    return item;
  });
  layer
    .selectAll("rect")
    .data(items)
    .join("rect")
    .attr("class", ({ name }) => name)
    .attr("fill", ({ fill }) => fill)
    .attr("x", (item) => item.x)
    .attr("y", (item) => item.y - 10)
    .attr("width", 24)
    .attr("height", 13);
  layer
    .selectAll("text")
    .data(items)
    .join("text")
    .attr("class", "label")
    .attr("x", (item) => item.x + 29)
    .attr("y", (item) => item.y)
    .text(({ text }) => text);
}

/** The area that holds a place, by its parameters. @param {Panel} panel @param {number} across @param {number} along */
function areaAt(panel, across, along) {
  return panel.areas.find(
    ({ polygon }) => polygon.filter((ring) => d3.polygonContains(ring, [across, along])).length % 2 === 1,
  );
}

/** The rows of a table of areas. @param {Panel} panel */
function areaRows(panel) {
  return panel.areas.map(({ id, says, part, doubt }) => [id, says, `${shown(100 * part, 3)} %`, doubt]);
}
