export {}; console.log("frame");
