/** Texts of this area. */
export const panel = {};
