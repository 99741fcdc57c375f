export const signals: {
  signal<T>(value: T): { value: T };
  effect(run: () => void): () => void;
  batch<T>(run: () => T): T;
  untracked<T>(run: () => T): T;
};
