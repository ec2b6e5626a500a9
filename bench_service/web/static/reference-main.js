// The page of the REST interface: the header with the benches' stops, and the operation that the address names, opened.
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const show = () => {
  const named = document.getElementById(location.hash.slice(1));
  if (named instanceof HTMLDetailsElement) named.open = true;
};
addEventListener("hashchange", show);
show();
sidePage(new State());
