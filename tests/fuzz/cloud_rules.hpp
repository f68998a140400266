#pragma once

#include "fuzz_target.hpp"

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>

namespace stillmap::fuzz {

/// By its header alone a server refuses no file that can be read.
inline void require_header(std::string_view text, std::string_view format, bool can_be_read) {
  const auto passes = taken<maps::InputError>([&] {
    maps::check_cloud_header(bytes_of(text), format, "fuzz");
    return true;
  });
  require(passes || !can_be_read, "what can be read has a header that passes");
}

}  // namespace stillmap::fuzz
