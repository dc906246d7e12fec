// Writes build.json: the sha256 over the sources, by which a test of the Python package sees that the built page is theirs.
// The digest is of "<path>\0<bytes>\0" for web/src/** and the files that decide about the build, sorted by path.
import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join, relative, sep } from "node:path";

const root = import.meta.dirname;

function files(folder) {
  return readdirSync(folder, { withFileTypes: true }).flatMap((entry) =>
    entry.isDirectory() ? files(join(folder, entry.name)) : [join(folder, entry.name)],
  );
}

const paths = [...files(join(root, "src")), ...["package-lock.json", "tsconfig.json", "vite.config.js"].map((n) => join(root, n))]
  .map((path) => relative(root, path).split(sep).join("/"))
  .sort((a, b) => (a < b ? -1 : 1));
const hash = createHash("sha256");
for (const path of paths) {
  hash.update(path).update("\0").update(readFileSync(join(root, path))).update("\0");
}
const record = { sources_sha256: hash.digest("hex"), files: paths.length };
writeFileSync(join(root, "../ecat/web/static/build.json"), `${JSON.stringify(record, null, 2)}\n`);
