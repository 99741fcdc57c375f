// What a type checker has to know of the page: the documents of the server, and what is no module of the page's own.
// No browser reads this file.

declare const MeshCat: any;
interface Window { fasbody: any; }

interface Parameter { name: string; words: string; unit: string; source: string; lower: number; upper: number; nominal: number; value: number; logarithmic: boolean; }
interface Model {
  type: "model"; name: string; quick: boolean; feet: Record<string, any>; parameters: Parameter[]; can_add_mass: boolean; periodic: boolean; recorded: boolean;
  settings: { frequency: number; peak_to_peak: number; added_mass: number; delay_s: number };
  excitation: string; about: string; curve_hz: number[]; look: any; fit: any; error: string; draft?: boolean; same?: boolean; adopt?: boolean;
}
interface Loop { x: number[]; force: number[]; }
// A foot in motion: `bodies` has three displacements and three turns of each body, frame by frame.
interface FootMotion {
  frames: number; duration: number; periodic: boolean; bodies: number[]; base: number[]; malleolus: number[]; loops: Record<string, Loop>;
  transmissibility: number[]; ratio: number | null; phase: number | null; fit_percent?: number | null; points?: { time: number[]; malleolus: number[] };
}
interface Motion { type: "motion"; feet: Record<string, FootMotion>; held: Record<string, number>; other: Record<string, number>; seconds?: number; travel?: any; tops?: any; }

// A recording of the table.
interface Row {
  id: number; file: string; label?: string; subject?: string; unread: string; problem: string; doubt: string; believed?: boolean; warnings: string[]; unit: string;
  frequency_hz?: number | null; samples?: number; rate_hz?: number; seconds?: number; start_s: number | null; end_s: number | null;
  body_mass_kg: number | null; added_mass_kg: number | null;
}
interface Recordings { session: string; rows: Row[]; shown: number; stale: string; undo?: [number, number]; unread?: number; }
interface Signal { time_s: number[]; m_s2: number[]; }
interface Signals {
  number: number; traces: Record<string, Signal>; spectra: Record<string, { frequency_hz: number[]; m_s2: number[] }>; seconds: number; rate_hz: number;
  part_s: [number, number] | null; refused: boolean; used: string[]; unused: string[];
}

interface Constant { name: string; unit: string; key: string; value: number; known: string; interval?: string; lower?: number; upper?: number; at_rest?: string; }
interface Branch { name: string; fit_percent: number | null; values: Record<string, number>; delay_s: number; rows: Constant[]; }
interface Fit { at: string; sentence: string; fit_percent: number; verdict: string; reason: string; warnings: string[]; branches: Branch[]; recordings: any[]; stale?: string; reported?: boolean; }
interface Point { added_mass_kg: number; frequency_hz: number; transmissibility: number; phase_lag_deg: number; lower: number; upper: number; branch?: string; }
interface Trace { file: string; time_s: number[]; measured: number[]; models: Record<string, { model: number[]; fit_percent: number }>; }
interface Fitted { number: number; at: number; fit: Fit; script: string; data: Point[]; curves: Point[]; chi_square: any[]; traces: Trace[]; }
interface Summary { number: number; at: number; model: string; recordings: string; files: string[]; settings: string; fit: string; verdict: string; constants: string[]; }
interface Comparison { columns: string[]; rows: string[][]; independent: boolean; fits: { name: string; branch: string; data: Point[]; curves: Point[] }[]; }

interface Rivals { columns: string[]; rows: string[][]; notes: string[]; adequate: boolean[]; script: string; }

interface Series { label: string; colour: string; x: number[]; y: number[]; points?: boolean | number; dashed?: boolean; low?: number[]; high?: number[]; }
// A slider's row; see `slider`.
interface Slider extends HTMLLabelElement {
  value: number; set(v: number): void; home(): void; nominal(v: number): void; beside(text: string): void; remark(text: string): void;
  band(limits: [number, number] | null, text?: string): void; show?(v: number): void;
}

// Where the sliders of the foot are; `amplify` is null until it is chosen.
interface State { frequency: number; peak_to_peak: number; added_mass: number; values: Record<string, number>; delay_s: number; slow: number; amplify: number | null; }
// See `page` and `bench` of store.js.
interface Page {
  model: Model; motion: Motion; sliders: Record<string, Slider>; busy: boolean; wanted: boolean;
  broken: string; problem: string; complaint: string; task: string; strip: string;
}
interface Bench {
  session: string; rows: Row[]; shown: number; lost: boolean; stale: string; undo: [number, number]; chosen: Set<number>; unticked: Set<number>; fittable: Map<number, boolean>;
  count: number; unread: number; fit: Fit | null; found: Fitted | null; fitNumber: number; branch: number; history: Summary[]; rivals: Rivals | null;
  free: Record<string, boolean>; bounds: Record<string, [number, number]>; asked: number; fitBegan: number; running: boolean; draft: boolean;
}

// What the server sends, by type.
interface Documents {
  model: Model; motion: Motion; error: { text: string }; broken: { text: string }; complaint: { text: string; of: string };
  data: Recordings; signals: Signals; columns: { number: number; columns: { name: string; unit: string }[]; said: any };
  progress: { running: boolean; what: string; done: number; total: number; share: number; left_s: number | null; seconds: number };
  fitted: Fitted; rivals: Rivals; history: { fits: Summary[] }; comparison: Comparison;
  reported: object; taken: object; kept: object; session_kept: object; session: { page: any; ids: Record<number, number>; note: string };
  models: { names: string[]; now: string; file: string; copy: string; text: string; digest: string; draft: boolean };
  checked: { text: string; line: number | null }; saved: { text: string; file: string; digest: string };
}
