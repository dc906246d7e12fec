import { defineConfig } from "vite";

// The built page is committed: it is what the wheel serves, so that nobody who installs ecat needs Node.
export default defineConfig({
  root: "src",
  base: "./",
  build: {
    outDir: "../../ecat/web/static",
    emptyOutDir: true,
    target: "es2022",
    // Nothing inline: the server's Content-Security-Policy allows files of its own origin only.
    assetsInlineLimit: 0,
    cssCodeSplit: true,
    modulePreload: { polyfill: false },
    reportCompressedSize: true,
  },
  test: { root: ".", include: ["tests/**/*.test.ts"], environment: "node" },
});
