// What an effect is called for people: one name on every page.
import { api } from "./api.js";

let asked = null; // the first question after the service's start takes it seconds

/** Gives `titleOf(effect)`; where the service does not answer, the name in words. */
export async function effectTitles() {
  asked ??= api.effects();
  const titles = new Map((await asked.catch(() => { asked = null; return []; })).map(({ name, title }) => [name, title]));
  return (effect) => titles.get(effect) ?? effect.replaceAll("_", " ");
}
