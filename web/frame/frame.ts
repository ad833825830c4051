export {};
console.log("frame");
