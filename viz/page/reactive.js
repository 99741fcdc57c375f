// State whose readers run again when it changes, by @preact/signals-core.
import { signals } from "./vendor/signals.js";
export const { batch, effect, untracked } = signals;

/**
 * An object of signals: an `effect` that reads one of its fields runs again when the field gets another value. What is
 * inside a field is not observed: assign a new object, array or set.
 * @template {object} T
 * @param {T} fields
 * @returns {T}
 */
export function store(fields) {
  const made = {};
  for (const [name, value] of Object.entries(fields)) {
    const field = signals.signal(value);
    Object.defineProperty(made, name, { enumerable: true, get: () => field.value, set: changed => { field.value = changed; } });
  }
  return /** @type {T} */ (made);
}
