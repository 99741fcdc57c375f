export const CM: any;
