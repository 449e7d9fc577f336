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

/** What an orbit is called. @param {Family} family @param {Entry | null} [entry] */
function titleOf(family, entry = null) {
  const event = entry ? `${entry.label} (${entry.id}) on ` : "";
  if (family.swept) return `attractor ${family.notation}, ${wayOf(family.swept)}`;
  return `${event}${family.id}, ${family.notation} (${family.word})`;
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

/** The parameters that vary, at a row. @param {Family} family @param {number} row @param {number} [digits] */
function placeText(family, row, digits = 10) {
  return page.varying
    .filter((name) => family.columns[name])
    .map((name) => `${symbol(name)} = ${shown(family.columns[name][row], digits)}`)
    .join(", ");
}
