// Stands in for libFuzzer where there is no clang: gives a target an empty input and then every
// file of its corpus, once, and all that a zip holds.
// usage: fuzz_NAME [FILE | FOLDER | ZIP]...
#include "fuzz_target.hpp"

#include <archive.h>
#include <archive_entry.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <vector>

namespace {

namespace fs = std::filesystem;

std::vector<fs::path> files_of(int count, char** names) {
  std::vector<fs::path> files;
  for (int i = 1; i < count; ++i) {
    const fs::path name = names[i];
    if (!fs::is_directory(name)) {
      files.push_back(name);
    } else {
      for (const auto& entry : fs::directory_iterator(name)) files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

void give(const std::string& input) {
  // A copy of exactly its size, so that a sanitizer sees a step beyond its end.
  const std::vector<std::uint8_t> bytes(input.begin(), input.end());
  LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
}

void give_all_of(const fs::path& zip) {
  const std::unique_ptr<archive, decltype(&archive_read_free)> packed(archive_read_new(),
                                                                      &archive_read_free);
  archive_read_support_format_zip(packed.get());
  constexpr std::size_t kBlock = 1U << 16U;
  int code = archive_read_open_filename(packed.get(), zip.c_str(), kBlock);
  archive_entry* entry = nullptr;
  while (code == ARCHIVE_OK &&
         (code = archive_read_next_header(packed.get(), &entry)) == ARCHIVE_OK) {
    std::printf("  %s\n", archive_entry_pathname(entry));
    std::fflush(stdout);
    std::string input(static_cast<std::size_t>(archive_entry_size(entry)), '\0');
    const la_ssize_t got = archive_read_data(packed.get(), input.data(), input.size());
    if (got != static_cast<la_ssize_t>(input.size())) code = ARCHIVE_FATAL;
    give(input);
  }
  if (code != ARCHIVE_EOF) throw std::runtime_error(zip.string() + ": cannot be unpacked");
}

}  // namespace

int main(int count, char** names) {
  give("");
  const std::vector<fs::path> files = files_of(count, names);
  for (const fs::path& file : files) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) {
      std::fprintf(stderr, "%s: cannot be read\n", file.c_str());
      return 1;
    }
    std::printf("%s\n", file.c_str());
    std::fflush(stdout);
    if (file.extension() == ".zip") {
      give_all_of(file);
      continue;
    }
    give({std::istreambuf_iterator<char>(stream), {}});
  }
  if (count > 1 && files.empty()) {
    std::fprintf(stderr, "no corpus\n");
    return 1;
  }
  return 0;
}
