/** Texts of this area. */
export const fleet = {};
