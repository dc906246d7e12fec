#!/usr/bin/env bash
# Makes the environment in which tensorflow_datasets reads what ecat writes: `tests/conformance/tfds_env.sh`, then
# `pytest tests/formats/datasets/test_rlds.py`.  Some minutes and 2 GB, once; a second call finds it there.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=${ECAT_TFDS_ENV:-.venv/tfds}
wanted=tests/conformance/tfds_env.sh

if [[ -f $folder/.installed ]] && cmp -s "$wanted" "$folder/.installed"; then
    exit 0
fi
rm -rf "$folder"
"${PYTHON:-python3}" -m venv --clear "$folder"
"$folder/bin/python" -m pip install --quiet --disable-pip-version-check --only-binary :all: \
    'tensorflow-cpu>=2.18' 'tensorflow-datasets>=4.9.8'
cp "$wanted" "$folder/.installed"
