// Two bundles: the page, and the script that the dashboard adds to viser's page in the frame.

import { defineConfig } from "vite";

const output = "../src/tsd_twin/dashboard/bundle";

export default defineConfig({
  base: "./",
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: output,
    emptyOutDir: false,
    target: "es2022",
    modulePreload: false,
    license: { fileName: "LICENSES.txt" },
    // Fixed names, without hashes, so that a rebuilt bundle shows as a small difference.
    rolldownOptions: {
      input: { page: "src/main.tsx", frame: "frame/frame.ts" },
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
        // A classic script, which runs before viser's module: its names must not be global.
        postBanner: (chunk) => (chunk.name === "frame" ? "(() => {" : ""),
        postFooter: (chunk) => (chunk.name === "frame" ? "})();" : ""),
      },
    },
  },
  test: {
    environment: "happy-dom",
    include: ["tests/**/*.test.{ts,tsx}"],
    setupFiles: ["tests/support/empty_frames.ts"],
  },
} as Parameters<typeof defineConfig>[0]);
