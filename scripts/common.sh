# Sourced by the other scripts: where things are, and the few questions that all of them ask.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
export LC_ALL=C.UTF-8 PYTHONUTF8=1 PIP_DISABLE_PIP_VERSION_CHECK=1
# Debian's cargo is in /usr/bin; rustup's may not be on the PATH.
[ -d "$HOME/.cargo/bin" ] && PATH="$PATH:$HOME/.cargo/bin"
# One cache for every checkout of the project.
export CCACHE_BASEDIR="$root" CCACHE_NOHASHDIR=1
venv="$root/.venv"

say() { printf '== %s\n' "$*"; }
die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# Jobs: one per core, and no more than memory carries at 1.5 GiB each.
jobs() {
  local cores mem
  cores=$(nproc)
  mem=$(awk '/^MemTotal/ {print int($2 / 1572864)}' /proc/meminfo)
  echo $((mem < 1 ? 1 : mem < cores ? mem : cores))
}

# A CUDA 12 or newer compiler of the system's.
system_nvcc() {
  local nvcc
  for nvcc in "$(command -v nvcc || true)" /usr/local/cuda/bin/nvcc; do
    if [ -x "$nvcc" ] && "$nvcc" --version | grep -qE 'release (1[2-9]|[2-9][0-9])\.'; then return 0; fi
  done
  return 1
}

has_driver() { ldconfig -p 2>/dev/null | grep -q 'libcuda\.so\.1' || [ -e /dev/nvidiactl ]; }

# The compiler that scripts/setup installed from wheels.
venv_cuda() { compgen -G "$venv/lib/python3*/site-packages/nvidia/cu13/bin/nvcc" >/dev/null; }
