// Sentences of reasons and refusals in the language of the page; operators appear by their names.

import { PARAMETERS, type Code } from "../generated/codes";
import { en, type Sentences } from "../generated/sentences";
import type { Reason } from "../generated/wire";
import type { Link } from "../store/link";
import type { Refusal } from "../store/permission";
import de from "./de_sentences.json";
import { type Language, language, texts } from "./text";

const SENTENCES: Record<Language, Sentences> = { en, de };
const PART = /\[([^\]|]*)(?:\|([^\]]*))?\]/g;
const SLOT = /\{(\w+)(?::([+,]?)(?:\.(\d))?)?\}/g;
const FIRST_SLOT = /^\{(\w+)/;

/** Names of operators by id, from the status of the robot in view. */
let names: () => Readonly<Record<string, string>> = () => ({});

export function nameOperatorsBy(link: Link): void {
  names = () => link.state.value?.status.operators ?? {};
}

/** Return the name of an operator; without one, the id less the number of the page, or a guest. */
export function nameOf(operator: string): string {
  const [, id = operator, number = ""] = /^(.+)-([0-9a-f]{8})$/.exec(operator) ?? [];
  const unnamed = id === "web" ? texts().common.guest(number.slice(0, 4).toUpperCase()) : id;
  return names()[operator] ?? unnamed;
}

/** Return the text of a reason as part of a sentence; an unknown code is shown as its words. */
export function words(reason: Reason, named: Naming = nameOf): string {
  return fill(reason, named).text;
}

/** Return the text of a reason with a capital, unless an id comes first, and a full stop. */
export function sentence(reason: Reason, named: Naming = nameOf): string {
  const { text, keepsCase } = fill(reason, named);
  return `${keepsCase ? text : text.slice(0, 1).toUpperCase() + text.slice(1)}.`;
}

/** Return why the page or the robot refuses something, as a sentence. */
export function refusalText(refusal: Refusal): string {
  return refusal.by === "page" ? texts().common.refusals[refusal.code] : sentence(refusal.reason);
}

export type Naming = (operator: string) => string;

interface Filled {
  text: string;
  keepsCase: boolean;
}

function fill({ code, params = {}, cause }: Reason, named: Naming): Filled {
  const types = PARAMETERS[code as Code] as Record<string, string> | undefined;
  if (types === undefined) return { text: code.replaceAll("_", " "), keepsCase: false };
  const causes = cause ? fill(cause, named) : { text: "", keepsCase: false };
  const shown = (name: string, sign = "", decimals = ""): string =>
    name === "cause" ? causes.text : show(params[name] ?? "", named, types[name], sign, decimals);
  const { templates } = SENTENCES[language.value];
  const template = templates[code as Code].replace(PART, (_, inside: string, instead = "") => {
    const used = [...inside.matchAll(SLOT)].map(([, name]) => name as string);
    return used.every((name) => shown(name) !== "") ? inside : (instead as string);
  });
  const text = template.replace(SLOT, (_, name: string, sign: string, decimals: string) =>
    shown(name, sign, decimals),
  );
  const first = FIRST_SLOT.exec(template)?.[1];
  if (first === undefined) return { text, keepsCase: false };
  const isId = types[first] === "operator" || types[first] === "name";
  return { text, keepsCase: first === "cause" ? causes.keepsCase : isId };
}

function show(value: string | number, named: Naming, type = "", sign = "", decimals = ""): string {
  if (typeof value === "string") return showText(value, type, named);
  const whole = sign === "," ? 0 : undefined;
  const fixed = decimals === "" ? whole : Number(decimals);
  const digits = Math.abs(value).toLocaleString(language.value, {
    useGrouping: sign === ",",
    minimumFractionDigits: fixed,
    maximumFractionDigits: fixed ?? 10,
  });
  return (value < 0 ? "−" : sign.replace(",", "")) + digits;
}

const RIGHT_TO_LEFT = /[\p{Script=Hebrew}\p{Script=Arabic}\p{Script=Syriac}\p{Script=Thaana}]/u;

/** Return a name for use within a sentence, which it must not turn around. */
export function isolated(name: string): string {
  return RIGHT_TO_LEFT.test(name) ? `\u2068${name}\u2069` : name;
}

function showText(value: string, type: string, named: Naming): string {
  if (type === "operator") return isolated(named(value));
  const lists = SENTENCES[language.value].words as Record<string, Record<string, string>>;
  if (type === "servos") {
    const word = lists["servos"]?.[value.includes(", ") ? "several" : "one"] ?? "";
    return value === "" ? "" : `${word} ${value}`;
  }
  const list = lists[type];
  return list === undefined ? value : (list[value] ?? value.replaceAll("_", " "));
}
