#pragma once

#include <stdexcept>

namespace stillmap::server {

/// A program that was to help with a job was killed, crashed or took too long: it may do better
/// when it is tried again.
class ProgramCrash : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace stillmap::server
