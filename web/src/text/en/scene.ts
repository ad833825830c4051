/** Texts of this area. */
export const scene = {};
