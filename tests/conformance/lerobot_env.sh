#!/usr/bin/env bash
# Makes the environment in which lerobot itself reads what ecat writes: `tests/conformance/lerobot_env.sh`, then
# `pytest -m lerobot`.  Some minutes and 1.3 GB, once; a second call finds it there.
#
# lerobot 0.4.4 is the last that runs on Python 3.11.  Of what it asks for only what reading and writing data sets needs is
# installed; torchvision is tests/conformance/stubs.  PyTorch must be a build for processors: where pip does not find one,
# tell it the index of those (PIP_EXTRA_INDEX_URL).
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=${ECAT_LEROBOT_ENV:-.venv/lerobot}
wanted=tests/conformance/lerobot_env.sh

if [[ -f $folder/.installed ]] && cmp -s "$wanted" "$folder/.installed"; then
    exit 0
fi
rm -rf "$folder"
"${PYTHON:-python3}" -m venv --clear "$folder"
install=("$folder/bin/python" -m pip install --quiet --disable-pip-version-check --only-binary :all:)
"${install[@]}" 'torch==2.13.0+cpu' 'datasets>=4.1,<4.2' 'huggingface-hub>=0.35,<0.36' 'av>=15,<16' \
    'numpy>=2,<3' 'pandas>=2.3,<4' 'pillow>=11' 'safetensors>=0.6' 'packaging' 'psutil' 'pyyaml' 'requests'
"${install[@]}" --no-deps 'lerobot==0.4.4' 'accelerate>=1.10,<2'
cp "$wanted" "$folder/.installed"
