export { batch, effect, signal, untracked } from "@preact/signals-core";
