#pragma once

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

namespace stillmap::maps {

/// A file that is written from its beginning to its end, little endian.
class OutputFile {
 public:
  /// @throws StorageError, as all of it, naming the file and the system's reason.
  explicit OutputFile(std::filesystem::path file);

  void write(std::string_view bytes);
  template <typename Number>
    requires std::is_arithmetic_v<Number>
  void put(Number number) {
    write({reinterpret_cast<const char*>(&number), sizeof number});
  }
  /// From here on bytes go to the beginning again, over those that are there.
  void rewind();
  /// What is not closed may be short.
  void close();

 private:
  struct Close {
    void operator()(std::FILE* stream) const { std::fclose(stream); }
  };
  [[noreturn]] void fail() const;

  std::filesystem::path file_;
  /// Outlives the stream.
  std::unique_ptr<char[]> buffer_;
  std::unique_ptr<std::FILE, Close> stream_;
};

}  // namespace stillmap::maps
