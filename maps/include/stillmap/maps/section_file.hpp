#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

// The one container of binary files that are made from a map: header, section table, sections;
// little endian, without pointers. A section is an array of one type.
namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little, "files are little endian as they lie");

/// What a file of sections holds.
struct SectionFormat {
  std::array<char, 8> magic;
  /// Grows with every change of the file's layout or content. A file with another number is made
  /// again.
  std::uint32_t format = 1;
  /// Every section begins at a multiple of this power of two; zeros fill the gaps.
  std::uint32_t alignment = 1;
  /// For messages: "a map index".
  const char* what = "";
};

struct SectionHeader {
  std::array<char, 8> magic{};
  std::uint32_t format = 0;
  std::uint32_t sections = 0;
  std::uint64_t file_bytes = 0;
  /// CRC-32C of header and section table, this field taken as 0.
  std::uint32_t crc = 0;
  /// This and `about` mean what the format says.
  std::uint32_t count = 0;
  std::array<std::byte, 160> about{};

  template <typename About>
  [[nodiscard]] About read_about() const {
    static_assert(sizeof(About) <= 160 && std::is_trivially_copyable_v<About>);
    std::array<std::byte, sizeof(About)> bytes;
    std::copy_n(about.begin(), sizeof(About), bytes.begin());
    return std::bit_cast<About>(bytes);
  }
  template <typename About>
  void set_about(const About& value) {
    static_assert(sizeof(About) <= 160 && std::is_trivially_copyable_v<About>);
    const auto bytes = std::as_bytes(std::span(&value, 1));
    std::copy(bytes.begin(), bytes.end(), about.begin());
  }
};
static_assert(sizeof(SectionHeader) == 192);

struct Section {
  /// What it holds, and of which part: both mean what the format says.
  std::uint32_t kind = 0;
  std::uint32_t part = 0;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  /// Of one item.
  std::uint32_t item_bytes = 0;
  /// CRC-32C of the section.
  std::uint32_t crc = 0;
};
static_assert(sizeof(Section) == 32);

/// The beginning of a file as a reader or writer needs it: the header, then `sections` rows.
[[nodiscard]] constexpr std::size_t section_table_end(std::size_t sections) {
  return sizeof(SectionHeader) + sections * sizeof(Section);
}

/// Takes the next bytes of a file.
using AppendBytes = std::function<void(std::span<const std::byte>)>;

/// A section that is to be written.
struct SectionPart {
  /// All but `offset`.
  Section section;
  /// Appends as many bytes as the section says, the same each time.
  std::function<void(const AppendBytes&)> write;
};
/// @param bytes  outlive the part.
[[nodiscard]] SectionPart section_part(std::uint32_t kind, std::uint32_t part,
                                       std::span<const std::byte> bytes, std::size_t item_bytes);

/// Memory that is aligned as a cache line is, and as the sections of an index are.
struct alignas(64) CacheLine {
  std::array<std::byte, 64> bytes;
};

/// A whole file that is to be written.
class SectionFile {
 public:
  /// @param header with `count` and `about`; the other fields are filled in.
  SectionFile(const SectionFormat& format, const SectionHeader& header,
              std::vector<SectionPart> parts);

  /// From the beginning to the end.
  void write(const AppendBytes& append) const;
  /// The file in memory; zeros fill the last line.
  [[nodiscard]] std::vector<CacheLine> lines() const;

 private:
  std::uint32_t alignment_;
  SectionHeader header_;
  std::vector<Section> sections_;
  std::vector<SectionPart> parts_;
};

/// Fills in the fields of a header but `count` and `about`, for who writes section by section.
[[nodiscard]] SectionHeader sealed(const SectionFormat& format, SectionHeader header,
                                   std::span<const Section> sections, std::uint64_t file_bytes);

/// Header and section table of a file, checked: all sections lie inside the file.
class SectionTable {
 public:
  /// @param head       the beginning of the file, at least to the end of its section table.
  /// @param file_bytes of the whole file.
  /// @param name       of the file, for errors.
  /// @throws InputError when it is another kind of file, of another format, cut or damaged.
  SectionTable(std::span<const std::byte> head, std::uint64_t file_bytes,
               const SectionFormat& format, std::string name);

  [[nodiscard]] const SectionHeader& header() const { return header_; }
  [[nodiscard]] const std::vector<Section>& sections() const { return sections_; }
  /// Null when there is none.
  [[nodiscard]] const Section* find(std::uint32_t kind, std::uint32_t part) const;
  [[noreturn]] void refuse(const std::string& found, const std::string& expected) const;

 private:
  std::string name_;
  SectionHeader header_;
  std::vector<Section> sections_;
};

}  // namespace stillmap::maps
