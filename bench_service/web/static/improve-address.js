// What is chosen, found and under way stands in the address: a reload, or another person, goes on where it was.

const LISTS = ["look", "train"];
const WORDS = ["model", "mode", "comparison", "diagnosis", "added", "doing", "job", "effect"];

/** What an address says; lists where it names runs, else undefined. */
export function readAddress(search = location.search) {
  const said = new URLSearchParams(search);
  const words = WORDS.map((key) => [key, said.get(key) ?? undefined]);
  return Object.fromEntries([...words, ...LISTS.map((key) => [key, said.has(key) ? said.get(key).split(",").filter(Boolean) : undefined])]);
}

export function writeAddress(place) {
  const said = new URLSearchParams();
  for (const key of WORDS) if (place[key]) said.set(key, place[key]);
  for (const key of LISTS) if (place[key]?.length) said.set(key, place[key].join(","));
  const query = said.toString().replaceAll("%2C", ",");
  history.replaceState(null, "", `${location.pathname}${query ? `?${query}` : ""}${location.hash}`);
}
