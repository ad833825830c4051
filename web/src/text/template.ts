// Texts with places, in a subset of ICU MessageFormat: `{name}`, `{count, plural, =0 {no stop} one
// {# stop} other {# stops}}` and `{name, select, left {…} none {…} other {…}}`. `select` compares
// with `_` for characters other than letters and digits; `none` is null or an empty text.

export type Value = string | number | boolean | null;
export type Source = string | readonly Source[] | { readonly [key: string]: Source };

interface Place {
  name: string;
  kind: string | undefined;
  branches: ReadonlyMap<string, readonly Part[]>;
}
type Part = string | Place;

/** Parse a text; throws an error if its braces are not those of places and branches. */
export function parse(text: string): Part[] {
  let at = 0;
  const next = (pattern: RegExp): RegExpExecArray => {
    pattern.lastIndex = at;
    const found = pattern.exec(text);
    if (found === null) throw new Error(`unexpected text at character ${at} of: ${text}`);
    at = pattern.lastIndex;
    return found;
  };
  const parts = (): Part[] => {
    const found: Part[] = [];
    while (at < text.length && text[at] !== "}") {
      if (text[at] === "{") found.push(place());
      else found.push(next(/[^{}]+/y)[0]);
    }
    return found;
  };
  const place = (): Place => {
    const [, name = "", kind] = next(/\{(\w+)(?:, (plural|select),)?\s*/y);
    const branches = new Map<string, Part[]>();
    while (kind && text[at] !== "}") {
      const [, key = ""] = next(/(=?\w+) \{/y);
      branches.set(key, parts());
      next(/\}\s*/y);
    }
    next(/\}/y);
    return { name, kind, branches };
  };
  const all = parts();
  next(/$/y);
  return all;
}

/** Return the names of all places in a text, in the order of first appearance. */
export function namesOf(parts: readonly Part[]): string[] {
  const names = parts.flatMap((part) =>
    typeof part === "string" ? [] : [part.name, ...[...part.branches.values()].flatMap(namesOf)],
  );
  return [...new Set(names)];
}

/**
 * Return a table with a function for each text with places. Its arguments are the places in the
 * order of the English text, which a translation may change. `rules` belong to its language.
 */
export function tableOf(english: Source, translated: Source, rules: Intl.PluralRules): unknown {
  if (typeof english === "string") {
    const names = namesOf(parse(english));
    if (names.length === 0) return translated;
    const parts = parse(translated as string);
    return (...values: Value[]) =>
      format(parts, new Map(names.map((name, i) => [name, values[i] ?? null])), rules);
  }
  const of = (key: string) => (translated as Record<string, Source>)[key] as Source;
  const entries = Object.entries(english).map(
    ([key, each]) => [key, tableOf(each, of(key), rules)] as const,
  );
  return Array.isArray(english) ? entries.map(([, each]) => each) : Object.fromEntries(entries);
}

function format(
  parts: readonly Part[],
  values: ReadonlyMap<string, Value>,
  rules: Intl.PluralRules,
  count?: Value,
): string {
  const texts = parts.map((part) => {
    if (typeof part === "string")
      return count === undefined ? part : part.replaceAll("#", String(count));
    const value = values.get(part.name) ?? "";
    if (part.kind === undefined) return String(value);
    const isPlural = part.kind === "plural";
    const key = isPlural ? rules.select(Number(value)) : String(value).replace(/\W/g, "_");
    const { branches } = part;
    const branch =
      branches.get(`=${value}`) ?? branches.get(key || "none") ?? branches.get("other");
    return format(branch ?? [], values, rules, isPlural ? value : count);
  });
  return texts.join("");
}
