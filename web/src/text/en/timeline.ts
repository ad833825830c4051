/** Texts of this area. */
export const timeline = {};
