#include <stillmap/maps/section_file.hpp>

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstring>
#include <utility>

namespace stillmap::maps {
namespace {

std::uint64_t aligned(std::uint64_t bytes, std::uint32_t alignment) {
  return (bytes + alignment - 1) / alignment * alignment;
}

std::uint32_t crc_of(SectionHeader header, std::span<const Section> sections) {
  header.crc = 0;
  return crc32c(std::as_bytes(sections), crc32c(std::as_bytes(std::span(&header, 1))));
}

}  // namespace

SectionPart section_part(std::uint32_t kind, std::uint32_t part, std::span<const std::byte> bytes,
                         std::size_t item_bytes) {
  return {{.kind = kind,
           .part = part,
           .bytes = bytes.size(),
           .item_bytes = static_cast<std::uint32_t>(item_bytes),
           .crc = crc32c(bytes)},
          [bytes](const AppendBytes& append) { append(bytes); }};
}

SectionHeader sealed(const SectionFormat& format, SectionHeader header,
                     std::span<const Section> sections, std::uint64_t file_bytes) {
  header.magic = format.magic;
  header.format = format.format;
  header.sections = static_cast<std::uint32_t>(sections.size());
  header.file_bytes = file_bytes;
  header.crc = crc_of(header, sections);
  return header;
}

SectionFile::SectionFile(const SectionFormat& format, const SectionHeader& header,
                         std::vector<SectionPart> parts)
    : alignment_(format.alignment), parts_(std::move(parts)) {
  std::uint64_t end = aligned(section_table_end(parts_.size()), alignment_);
  for (const SectionPart& part : parts_) {
    sections_.push_back(part.section);
    sections_.back().offset = end;
    end = aligned(end + part.section.bytes, alignment_);
  }
  header_ = sealed(format, header, sections_, end);
}

void SectionFile::write(const AppendBytes& append) const {
  const std::vector<std::byte> zeros(alignment_);
  const auto fill_gap_after = [&](std::uint64_t end) {
    append(std::span(zeros).first(aligned(end, alignment_) - end));
  };
  append(std::as_bytes(std::span(&header_, 1)));
  append(std::as_bytes(std::span(sections_)));
  fill_gap_after(section_table_end(sections_.size()));
  for (const SectionPart& part : parts_) {
    part.write(append);
    fill_gap_after(part.section.bytes);
  }
}

std::vector<CacheLine> SectionFile::lines() const {
  std::vector<CacheLine> lines(aligned(header_.file_bytes, sizeof(CacheLine)) / sizeof(CacheLine));
  auto to = std::as_writable_bytes(std::span(lines)).begin();
  write([&](std::span<const std::byte> bytes) { to = std::copy(bytes.begin(), bytes.end(), to); });
  return lines;
}

SectionTable::SectionTable(std::span<const std::byte> head, std::uint64_t file_bytes,
                           const SectionFormat& format, std::string name)
    : name_(std::move(name)) {
  if (head.size() < sizeof(SectionHeader)) {
    refuse(std::to_string(file_bytes) + " bytes", format.what);
  }
  std::memcpy(&header_, head.data(), sizeof(header_));
  if (header_.magic != format.magic) refuse("another kind of file", format.what);
  if (header_.format != format.format) {
    refuse("format " + std::to_string(header_.format), "format " + std::to_string(format.format));
  }
  if (header_.file_bytes != file_bytes) {
    refuse(std::to_string(file_bytes) + " bytes", std::to_string(header_.file_bytes));
  }
  if (header_.sections > (head.size() - sizeof(header_)) / sizeof(Section)) {
    refuse(std::to_string(header_.sections) + " sections", "a section table inside the file");
  }
  sections_.resize(header_.sections);
  const auto table = head.subspan(sizeof(header_), header_.sections * sizeof(Section));
  std::copy(table.begin(), table.end(), std::as_writable_bytes(std::span(sections_)).begin());
  if (crc_of(header_, sections_) != header_.crc) {
    refuse("a header that does not fit its checksum", "an undamaged one");
  }
  for (const Section& section : sections_) {
    if (section.offset % format.alignment != 0 || section.offset > file_bytes ||
        section.bytes > file_bytes - section.offset) {
      refuse(
          std::to_string(section.bytes) + " bytes at " + std::to_string(section.offset),
          "a section inside the file, aligned to " + std::to_string(format.alignment) + " bytes");
    }
  }
}

const Section* SectionTable::find(std::uint32_t kind, std::uint32_t part) const {
  const auto found = std::find_if(sections_.begin(), sections_.end(), [&](const Section& section) {
    return section.kind == kind && section.part == part;
  });
  return found == sections_.end() ? nullptr : &*found;
}

void SectionTable::refuse(const std::string& found, const std::string& expected) const {
  throw InputError(name_, found, expected);
}

}  // namespace stillmap::maps
