#pragma once

#include <string_view>

namespace stillmap::server {

/// `server/openapi.json` as it was when the program was built.
[[nodiscard]] std::string_view openapi_document();

}  // namespace stillmap::server
