# Sourced by demo and test: makes .venv with the versions of constraints.txt, once, and enters it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

python=${PYTHON:-python3.11}
command -v "$python" >/dev/null || python=python3
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
  echo "merap needs Python 3.11 or newer; set PYTHON to one ($python is $("$python" --version))" >&2
  exit 2
fi

stamp=$(cat pyproject.toml scripts/constraints.txt | sha256sum | cut -d ' ' -f 1)
if [ "$(cat .venv/merap-stamp 2>/dev/null)" != "$stamp" ]; then
  echo "Installing merap and its pinned dependencies into .venv (once; about 1.5 GB) ..."
  "$python" -m venv --clear .venv
  .venv/bin/python -m pip install --quiet --disable-pip-version-check \
    --constraint scripts/constraints.txt --editable '.[all,dev]'
  echo "$stamp" >.venv/merap-stamp
fi
# shellcheck disable=SC1091
. .venv/bin/activate
