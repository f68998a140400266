#pragma once

#include <cstddef>
#include <functional>

namespace stillmap::server {

/// Calls it with 0 to count - 1 from so many threads. After the first that throws no call begins,
/// and it is thrown at the end.
void for_each_in_parallel(std::size_t count, std::size_t threads,
                          const std::function<void(std::size_t)>& call);

}  // namespace stillmap::server
