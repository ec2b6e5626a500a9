// The page on which a model is made, held against measurements, and improved.
import { improvePanel } from "./improve-panel.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const state = new State();
const { load } = improvePanel(state);
// Runs and models may have come while the link was down, and with each change of a bench.
sidePage(state, { onBench: load, onLive: load });
load();
