// Stands in for libFuzzer where there is no clang: gives a target an empty input and then each
// of these files, once, and says what processor time each took.
// usage: fuzz_NAME [FILE | FOLDER]...
#include "fuzz_target.hpp"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
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
    const std::string input{std::istreambuf_iterator<char>(stream), {}};
    std::printf("%s\n", file.c_str());
    std::fflush(stdout);
    const std::clock_t begin = std::clock();
    give(input);
    std::printf("%.3f s %s\n", static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC,
                file.c_str());
  }
  if (count > 1 && files.empty()) {
    std::fprintf(stderr, "no inputs\n");
    return 1;
  }
  return 0;
}
