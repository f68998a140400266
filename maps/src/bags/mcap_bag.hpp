#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "bags/bag.hpp"
#include "bags/mcap_records.hpp"

namespace stillmap::maps::mcap {

/// An MCAP file. With an index in its summary that fits the file, only chunks that hold what is
/// wanted are read; otherwise, and where the file was cut off, record after record as far as they
/// go. Of chunks the CRC-32 is checked, of packed ones by `visit`, of others when the first of
/// their messages is read; and that of the summary. The one over the whole data section is not: it
/// would take reading everything.
class McapBag final : public Bag {
 public:
  /// @throws InputError for a file that does not begin as MCAP, or whose channels are too many;
  /// StorageError.
  /// @param shown_as  what it is called, where that is another.
  explicit McapBag(const std::filesystem::path& file, const std::filesystem::path& shown_as = {});

  [[nodiscard]] BagFormat format() const override { return BagFormat::kMcap; }
  [[nodiscard]] const std::filesystem::path& file() const override { return reader_.file(); }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return topics_; }
  BagDamage visit(std::span<const std::size_t> head_bytes, const Take& take) const override;
  [[nodiscard]] FileBytes read(const MessagePlace& place) const override;
  /// Whether the summary's index is used.
  [[nodiscard]] bool is_indexed() const { return !chunks_.empty(); }

 private:
  bool read_summary();
  void find_channels();
  void set_topics();
  [[nodiscard]] std::unique_ptr<Chunk> chunk_at(std::uint64_t offset) const;
  [[nodiscard]] std::unique_ptr<Chunk> take_chunk(const MessagePlace& place) const;
  [[nodiscard]] bool is_checked(std::uint64_t offset) const;
  [[nodiscard]] std::size_t read_and_check(Chunk& chunk, const MessagePlace& place,
                                           std::span<std::byte> into) const;

  FileReader reader_;
  Channels channels_;
  /// In the order of the file; empty without an index.
  std::vector<ChunkIndex> chunks_;
  std::vector<BagTopic> topics_;
  std::map<std::uint16_t, std::size_t> topic_of_channel_;

  mutable OpenChunks open_;
  mutable std::mutex mutex_;
  /// Chunks that are not packed and whose CRC fits.
  mutable std::set<std::uint64_t> checked_;
};

}  // namespace stillmap::maps::mcap
