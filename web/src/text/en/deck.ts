/** Texts of this area. */
export const deck = {};
