#!/usr/bin/env bash
# linked_libraries.sh PROGRAM: what a server carries must stay small, below 60 shared libraries and without the
# mapper's PCL and MRPT's graphs (of MRPT the poses alone). (Every one of them is start-up time, memory and a thing to
# patch.)
set -euo pipefail
libraries=$(ldd "$1")
count=$(grep -c '=>' <<<"$libraries")
echo "$1: $count shared libraries"
if grep -q 'not found' <<<"$libraries"; then echo "$libraries" | grep 'not found'; exit 1; fi
if grep -E 'libpcl|libmrpt-(graph|slam|obs|opengl|gui|img|maps)|libembree|libopencv' <<<"$libraries"; then exit 1; fi
[ "$count" -lt 60 ]
