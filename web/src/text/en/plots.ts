/** Texts of this area. */
export const plots = {};
