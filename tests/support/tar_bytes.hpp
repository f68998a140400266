#pragma once

#include "store/archive.hpp"

#include <archive.h>
#include <archive_entry.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace stillmap::test {

/// One header block of a tar as it is said here, true or not.
struct TarHeader {
  std::string name;
  std::uint64_t bytes = 0;
  char type = '0';
  std::string link{};
  /// Instead of the octal digits of `bytes`.
  std::string size_field{};
  std::string prefix{};
  std::string owner = "root";
  unsigned mode = 0644;
};

inline std::string octal(std::uint64_t number, std::size_t digits) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%0*llo", static_cast<int>(digits),
                static_cast<unsigned long long>(number));
  return text.data();
}

/// A ustar header with its checksum.
inline std::string tar_block(const TarHeader& header) {
  std::string block(512, '\0');
  const auto put = [&](std::size_t at, std::string_view text, std::size_t most) {
    block.replace(at, std::min(text.size(), most), text.substr(0, most));
  };
  put(0, header.name, 100);
  put(100, octal(header.mode, 7), 8);
  put(108, octal(0, 7), 8);
  put(116, octal(0, 7), 8);
  put(124, header.size_field.empty() ? octal(header.bytes, 11) : header.size_field, 12);
  put(136, octal(0, 11), 12);
  block[156] = header.type;
  put(157, header.link, 100);
  put(257, std::string_view("ustar\00000", 8), 8);
  put(265, header.owner, 32);
  put(345, header.prefix, 155);
  put(148, "        ", 8);
  unsigned sum = 0;
  for (const char byte : block) sum += static_cast<unsigned char>(byte);
  put(148, octal(sum, 6) + '\0' + ' ', 8);
  return block;
}

inline std::string padded(std::string bytes) {
  bytes.resize((bytes.size() + 511) / 512 * 512);
  return bytes;
}

/// The two blocks that end a tar.
inline std::string tar_end() { return std::string(1024, '\0'); }

inline std::string tar_file(const std::string& name, const std::string& bytes) {
  return tar_block({.name = name, .bytes = bytes.size()}) + padded(bytes);
}

inline std::string tar_folder(const std::string& name) {
  return tar_block({.name = name, .type = '5'});
}

/// One record of a pax header: its own length, name and value.
inline std::string pax_record(const std::string& key, const std::string& value) {
  const std::string rest = " " + key + "=" + value + "\n";
  std::size_t length = rest.size() + 1;
  while (std::to_string(length).size() + rest.size() != length)
    length = std::to_string(length).size() + rest.size();
  return std::to_string(length) + rest;
}

/// A pax header in front of an entry, with these records.
inline std::string pax_header(const std::string& records, char type = 'x') {
  return tar_block({.name = "PaxHeader/x", .bytes = records.size(), .type = type}) +
         padded(records);
}

enum class Packing { kNone, kGzip, kZstd };

/// Packs bytes as they are, by libarchive.
inline std::string packed(const std::string& bytes, Packing packing) {
  if (packing == Packing::kNone) return bytes;
  struct Free {
    void operator()(archive* writer) const { archive_write_free(writer); }
    void operator()(archive_entry* entry) const { archive_entry_free(entry); }
  };
  std::string written;
  const auto append = [](archive*, void* to, const void* from, std::size_t size) -> la_ssize_t {
    static_cast<std::string*>(to)->append(static_cast<const char*>(from), size);
    return static_cast<la_ssize_t>(size);
  };
  const std::unique_ptr<archive, Free> writer(archive_write_new());
  const std::unique_ptr<archive_entry, Free> entry(archive_entry_new());
  archive_entry_set_filetype(entry.get(), AE_IFREG);
  archive_write_set_format_raw(writer.get());
  archive_write_add_filter(writer.get(),
                           packing == Packing::kGzip ? ARCHIVE_FILTER_GZIP : ARCHIVE_FILTER_ZSTD);
  // No padding behind the packed bytes.
  archive_write_set_bytes_in_last_block(writer.get(), 1);
  archive_write_open(writer.get(), &written, nullptr, append, nullptr);
  archive_write_header(writer.get(), entry.get());
  const auto size = static_cast<la_ssize_t>(bytes.size());
  if (archive_write_data(writer.get(), bytes.data(), bytes.size()) != size ||
      archive_write_close(writer.get()) != ARCHIVE_OK)
    throw std::runtime_error("cannot pack");
  return written;
}

/// Gives bytes in pieces of at most this size.
inline server::ByteSource source_of(std::string bytes, std::size_t piece = SIZE_MAX) {
  return [bytes = std::move(bytes), piece, at = std::size_t{0}](std::span<char> into) mutable {
    const std::size_t size = std::min({into.size(), piece, bytes.size() - at});
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), size, into.begin());
    at += size;
    return size;
  };
}

}  // namespace stillmap::test
