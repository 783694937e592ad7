#!/usr/bin/env bash
# Builds and runs the core's tests with the compilers that are installed: GCC and Clang for baseline
# x86-64 and for AVX2, GCC without its vectors, and for Arm under qemu. Arguments: compiler flags.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT

try() {  # name, compiler and its flags, what runs the result
  local compiler=${2%% *}
  command -v "$compiler" >/dev/null || { echo "$1: no $compiler here"; return; }
  for test in batch core kernels lanes factor workspace allocation servo threads extremes floating_point; do
    # shellcheck disable=SC2086  # the flags are words
    $2 $FLAGS -O3 -pthread cpp/tests/${test}_test.cpp -o "$folder/$test"
    $3 "$folder/$test" >"$folder/out" || { cat "$folder/out"; echo "$1: $test fails"; exit 1; }
  done
  echo "$1: all tests pass"
}

FLAGS="$*"
for compiler in g++ clang++; do
  if [ "$(uname -m)" = x86_64 ]; then
    try "$compiler, baseline x86-64" "$compiler" ""
    try "$compiler, AVX2 and FMA" "$compiler -mavx2 -mfma" ""
  else
    try "$compiler, $(uname -m)" "$compiler" ""
  fi
done
try "g++, plain lanes" "g++ -DGRASPFORCE_PLAIN_LANES" ""
try "g++, 64-bit Arm" "aarch64-linux-gnu-g++ -static" qemu-aarch64
