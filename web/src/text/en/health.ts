/** Texts of this area. */
export const health = {};
