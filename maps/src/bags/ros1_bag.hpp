#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bags/bag.hpp"
#include "bags/ros1_records.hpp"

namespace stillmap::maps::ros1 {

/// A bag of ROS 1, format 2.0. With an index at its end that fits the file, only chunks that hold
/// what is wanted are read; otherwise, and where the recording was cut off (`*.bag.active`), record
/// after record as far as they go. The format has no checksums: bytes that changed on the disk are
/// found only where lz4 or bzip2 find them.
class Ros1Bag final : public Bag {
 public:
  /// @param shown_as  what it is called, where that is another.
  /// @throws InputError for a file that does not begin as such a bag; StorageError.
  explicit Ros1Bag(const std::filesystem::path& file, const std::filesystem::path& shown_as = {});

  [[nodiscard]] BagFormat format() const override { return BagFormat::kRos1; }
  [[nodiscard]] const std::filesystem::path& file() const override { return reader_.file(); }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return topics_; }
  BagDamage visit(std::span<const std::size_t> head_bytes, const Take& take) const override;
  [[nodiscard]] FileBytes read(const MessagePlace& place) const override;
  /// Whether the index at the end is used.
  [[nodiscard]] bool is_indexed() const { return !chunks_.empty(); }

 private:
  class Visit;

  bool read_index();
  bool read_index_at(std::uint64_t index);
  void find_connections();
  void set_topics();
  /// @param offset  of its record.
  [[nodiscard]] std::unique_ptr<Chunk> chunk_at(std::uint64_t offset) const;

  FileReader reader_;
  Connections connections_;
  /// In the order of the file; empty without an index.
  std::vector<ChunkInfo> chunks_;
  std::vector<BagTopic> topics_;
  std::map<std::uint32_t, std::size_t> topic_of_connection_;
  mutable OpenChunks open_;
};

}  // namespace stillmap::maps::ros1
