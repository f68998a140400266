#include "option_table.hpp"

#include <algorithm>
#include <iterator>

#include "option_rows.hpp"

namespace stillmap::server {
namespace {

std::vector<Option> make_table() {
  std::vector<Option> table;
  for (auto* part :
       {listening_options, admission_options, store_options, job_options, running_options}) {
    std::ranges::move(part(), std::back_inserter(table));
  }
  return table;
}

}  // namespace

std::span<const Option> all_options() {
  static const std::vector<Option> table = make_table();
  return table;
}

const Option* find_option(std::string_view key) {
  const std::span<const Option> table = all_options();
  const auto found = std::ranges::find(table, key, &Option::key);
  return found == table.end() ? nullptr : &*found;
}

}  // namespace stillmap::server
