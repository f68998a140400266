#include "errors/upload_errors.hpp"

#include <fmt/format.h>

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "store/package_store.hpp"

namespace stillmap::server {
namespace {

/// @return bytes of "NUMBER/" in front; 0 when there is none.
std::size_t number_in_front(std::string_view text) {
  const std::size_t end = text.find_first_not_of("0123456789");
  return end != 0 && end != std::string_view::npos && text[end] == '/' ? end + 1 : 0;
}

/// @return bytes of a place that the store gave an upload or a job, as "drives/12/drive-12/"; 0
/// when the text does not begin with one.
std::size_t inner_place(std::string_view text) {
  constexpr std::string_view kIncoming = "packages/.incoming-";
  if (text.starts_with(kIncoming)) {
    const std::size_t end = text.find_first_of("/ :\n", kIncoming.size());
    return end != std::string_view::npos && text[end] == '/' ? end + 1 : 0;
  }
  constexpr std::array<std::array<std::string_view, 2>, 4> kPlaces = {
      {{"drives/", ".incoming-drive/"},
       {"drives/", "drive-"},
       {"drives/", "parts/"},
       {"jobs/", "scratch/"}}};
  for (const auto& [folder, part] : kPlaces) {
    if (!text.starts_with(folder)) continue;
    const std::size_t number = number_in_front(text.substr(folder.size()));
    const std::size_t begin = folder.size() + number;
    if (number == 0 || !text.substr(begin).starts_with(part)) continue;
    const std::size_t end = begin + part.size();
    if (part.back() == '/') return end;
    const std::size_t rest = number_in_front(text.substr(end));
    if (rest > 0) return end + rest;
  }
  return 0;
}

/// The same of the folder of an unpacked drive itself: "drives/12/drive-12", or where it was
/// unpacked. @return its bytes; 0 when the text goes on in it, or does not begin with one.
std::size_t whole_drive(std::string_view text, std::string_view& number) {
  constexpr std::string_view kDrives = "drives/";
  if (!text.starts_with(kDrives)) return 0;
  const std::size_t digits = number_in_front(text.substr(kDrives.size()));
  if (digits == 0) return 0;
  number = text.substr(kDrives.size(), digits - 1);
  for (const std::string& folder :
       {std::string(".incoming-drive"), fmt::format("drive-{}", number)}) {
    const std::size_t begin = kDrives.size() + digits;
    const std::size_t end = begin + folder.size();
    if (text.substr(begin).starts_with(folder) && text.find_first_of("/0123456789", end) != end)
      return end;
  }
  return 0;
}

}  // namespace

std::string without_folder(std::string text, const std::filesystem::path& folder) {
  const std::string prefix = folder.string() + "/";
  for (std::size_t at = text.find(prefix); at != std::string::npos; at = text.find(prefix, at)) {
    text.erase(at, prefix.size());
    std::string_view number;
    const std::string_view rest = std::string_view(text).substr(at);
    if (const std::size_t whole = whole_drive(rest, number)) {
      text.replace(at, whole, fmt::format("drive {}", number));
    } else {
      text.erase(at, inner_place(rest));
    }
  }
  return text;
}

std::string without_places(std::string text, const PackageStore& store) {
  // Of blobs: which server has them is nobody's to know.
  if (text.starts_with("s3://"))
    return "its files cannot be fetched just now; the log of the server says why";
  return without_folder(without_folder(std::move(text), store.packages().path().parent_path()),
                        store.folder());
}

}  // namespace stillmap::server
