/** Texts of this area. */
export const bar = {};
