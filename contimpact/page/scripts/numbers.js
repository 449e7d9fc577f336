// Numbers and names as a reader sees them.

/**
 * A number to some digits, without zeros at its end.
 * @param {number | null | undefined} value
 * @param {number} [digits]
 */
function shown(value, digits = 10) {
  if (value === null || value === undefined || Number.isNaN(value)) return "-";
  if (!Number.isFinite(value)) return value > 0 ? "infinite" : "-infinite";
  const text = String(Number(value.toPrecision(digits)));
  return text.startsWith("-") ? `\u2212${text.slice(1)}` : text;
}

/** @param {number} value */
function ofPi(value) {
  for (let below = 1; below <= page.pi_below; below++) {
    const above = (value / Math.PI) * below,
      whole = Math.round(above);
    if (Math.abs(whole) > page.pi_above) break;
    if (whole && Math.abs(above - whole) < 1e-12 * Math.max(1, Math.abs(above))) {
      const top = Math.abs(whole) === 1 ? "" : String(Math.abs(whole));
      return `${whole < 0 ? "\u2212" : ""}${top}\u03c0${below > 1 ? `/${below}` : ""}`;
    }
  }
  return shown(value, 6);
}

/** A name with a Greek letter for its own, as `beta`, `gbar` or `eta1`. @param {string} name */
function symbol(name) {
  const [, letter, bar, index] = /^([A-Za-z]+?)(bar)?(_[A-Za-z0-9]+|[0-9]+)?$/.exec(name) ?? [];
  if (!letter || (letter.length > 1 && !page.greek[letter])) return name;
  return (page.greek[letter] ?? letter) + (bar ? "\u0305" : "") + (index ?? "");
}

/** The label of an axis: a parameter and its unit. @param {string} name */
function withUnit(name) {
  const unit = page.units[name];
  return symbol(name) + (unit ? ` (${unit})` : "");
}

/** Parameters in a row. @param {Record<string, number>} values */
function valuesText(values) {
  return Object.entries(values)
    .map(([name, value]) => `${symbol(name)} = ${ofPi(value)} ${page.units[name] ?? ""}`.trim())
    .join(", ");
}

/**
 * A complex number.
 * @param {number} real
 * @param {number} imaginary
 */
function complex(real, imaginary) {
  if (!Number.isFinite(real)) return "infinite";
  if (imaginary === 0) return shown(real, 8);
  return `${shown(real, 8)} ${imaginary < 0 ? "\u2212" : "+"} ${shown(Math.abs(imaginary), 8)}i`;
}

/** The multipliers of a row; none of motions that have none. @param {Family} family @param {number} row @returns {[number, number][]} */
function multipliersAt(family, row) {
  const m = family.multipliers.length / (2 * family.rows),
    from = 2 * row * m;
  const pairs = Array.from({ length: m }, (_, j) => family.multipliers.slice(from + 2 * j, from + 2 * j + 2));
  return pairs
    .map(([re, im]) => /** @type {[number, number]} */ ([re, im]))
    .filter(([re]) => !Number.isNaN(re));
}

/** What an orbit is called. @param {Family} family */
function titleOf(family) {
  if (family.swept) return `attractor ${family.notation}, ${wayOf(family.swept)}`;
  return `${family.id}, ${family.notation}${family.word ? ` (${family.word})` : ""}`;
}

/** A symbol, with the tilde of ghosts over it. @param {Parts} parts */
function symbolOf({ symbol: name, tilde }) {
  if (!tilde) return name;
  const [first, second] = name;
  return name.length === 1 ? `${first}\u0303` : name.length === 2 ? `${first}\u0360${second}` : `~${name}`;
}

const severally = new Set(
  d3
    .rollups(
      page.entries,
      (own) => new Set(own.map(({ notation }) => notation)).size,
      ({ kind }) => kind,
    )
    .filter(([, orbits]) => orbits > 1)
    .map(([kind]) => kind),
);

/** The orbit, behind a label that does not name it and of a kind that is found on several. @param {Entry} entry */
function orbitBehind({ parts, kind, notation }) {
  return !parts.above && severally.has(kind) ? `(${notation.slice(0, 24)})` : "";
}

/** The label of an event as it is set, for texts. @param {Entry} entry */
function labelOf(entry) {
  const { parts } = entry,
    set = document.createElement("span");
  set.className = "set";
  set.title = entry.label;
  set.append(symbolOf(parts));
  for (const [name, text] of [
    ["sub", parts.below],
    ["sup", parts.above],
  ]) {
    if (!text) continue;
    const word = document.createElement(name);
    word.textContent = text;
    set.append(word);
  }
  set.append(orbitBehind(entry));
  return set;
}

const ruler = document.createElement("canvas").getContext("2d");

/** How wide a lowered or raised word is. @param {string} text */
function wordWidth(text) {
  if (!ruler) return 5 * text.length;
  ruler.font = `8.5px ${getComputedStyle(document.body).fontFamily}`;
  return ruler.measureText(text).width;
}

/** Write a label into a text of a picture: its words one over the other. @param {Selected} text @param {Parts} parts @param {string} behind */
function writeLabel(text, parts, behind = "") {
  text.text(null).append("tspan").text(symbolOf(parts));
  const words = /** @type {[string, number][]} */ ([
    [parts.below, 3],
    [parts.above, -5],
  ]).filter(([word]) => word);
  words.sort(([a], [b]) => wordWidth(a) - wordWidth(b));
  let level = 0,
    back = -1;
  for (const [word, up] of words) {
    text
      .append("tspan")
      .attr("class", "word")
      .attr("dx", -back)
      .attr("dy", up - level)
      .text(word);
    [level, back] = [up, wordWidth(word)];
  }
  if (behind) text.append("tspan").attr("dy", -level).text(behind);
}

/** About how long a label is, in letters. @param {Parts} parts @param {string} behind */
function labelLength(parts, behind = "") {
  return parts.symbol.length + 0.8 * Math.max(parts.below.length, parts.above.length) + behind.length + 0.3;
}

/** How attractors were found: by what changes along the sweep. @param {Swept} swept */
function wayOf(swept) {
  if (swept.direction === "random") return "from random starts";
  return `simulated, ${symbol(page.parameter)} ${swept.direction === "up" ? "rising" : "falling"}`;
}

/** Whether an orbit can be observed, and why not. @param {Family} family @param {number} row @param {Entry | null} [entry] */
function stateOf(family, row, entry = null) {
  if (entry) {
    if (entry.ghost) return `ghost: ${entry.why ?? entry.reason ?? "unstable or unphysical"}`;
    return `real event${entry.criticality ? `, ${entry.criticality}` : ""}`;
  }
  if (family.swept) return family.swept.kind;
  const unstable = family.unstable?.[row] ?? 0,
    stability = unstable ? `unstable (${unstable} multiplier${unstable > 1 ? "s" : ""} outside)` : "stable";
  if (family.physical && !family.physical[row])
    return `unphysical: ${family.reason(row) || "no reason recorded"}; ${stability}`;
  return `${stability}, physical`;
}

/** The margin of a row's orbit, and the event that it is the distance to; empty where there is none. @param {Family} family @param {number} row */
function marginText(family, row) {
  const margin = family.columns.margin?.[row] ?? NaN;
  if (Number.isNaN(margin)) return "";
  return margin < Infinity ? `${shown(margin, 6)} to ${family.nearest(row)}` : "no event within reach";
}

/** The value at a row on the axis shown. @param {Family} family @param {number} row @param {number} [digits] */
function valueText(family, row, digits = 10) {
  return `${symbol(state.x)} = ${shown(family.columns[state.x]?.[row], digits)}`;
}

/** The parameters that vary, at a row. @param {Family} family @param {number} row @param {number} [digits] */
function placeText(family, row, digits = 10) {
  return page.varying
    .filter((name) => family.columns[name])
    .map((name) => `${symbol(name)} = ${shown(family.columns[name][row], digits)}`)
    .join(", ");
}
