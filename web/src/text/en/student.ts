/** Texts of this area. */
export const student = {};
