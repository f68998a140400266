#pragma once

#include <string>

#include "record_output.hpp"

namespace stillmap::maps::rawlog {

/// Takes from this process what a reader of hostile bytes does not need: it dies with its parent,
/// has 256 MiB for its data and writes no files.
void confine();

/// Says what clouds and poses a rawlog holds, up to its end or what cannot be read.
/// @throws std::system_error when the output is closed.
void read(const std::string& file, RecordOutput& output);

}  // namespace stillmap::maps::rawlog
