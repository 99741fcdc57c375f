// The door to meshcat, a script before all modules, and to the three.js inside it.
export const { THREE, Viewer } = MeshCat;
