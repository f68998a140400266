#pragma once

#include <map>
#include <span>
#include <vector>

#include "bags/bag.hpp"
#include "bags/mcap_records.hpp"

namespace stillmap::maps::mcap {

/// Goes through the records of a file and hands on the wanted messages; those of a chunk when its
/// CRC-32 was found to fit.
class Visitor {
 public:
  struct Wanted {
    const std::map<std::uint16_t, std::size_t>* topic_of_channel = nullptr;
    /// One a topic.
    std::span<const std::size_t> head_bytes;
  };
  /// @param channels  to be filled with what comes by, or null.
  Visitor(const FileReader& file, const Wanted& wanted, const Bag::Take& take, Channels* channels);

  /// All records from the first on, up to the data's end or where the file is cut off.
  void visit_file();
  /// One chunk, whose record's content is at `offset`.
  void visit_chunk(std::uint64_t offset, std::uint64_t length);
  [[nodiscard]] const BagDamage& damage() const { return damage_; }
  void add_damage(std::uint64_t offset, const std::string& what);

 private:
  /// @return whether the last one ends within the chunk.
  bool visit_records_of(Chunk& chunk, std::uint64_t offset);
  void take_message(Record& record, std::uint64_t outer, std::uint64_t inner);
  void hand_on();

  const FileReader* file_;
  Wanted wanted_;
  const Bag::Take* take_;
  Channels* channels_;
  BagDamage damage_;
  struct Held {
    std::size_t topic = 0;
    MessagePlace place;
    std::int64_t recorded_ns = 0;
    std::size_t head_begin = 0;
    std::size_t head_bytes = 0;
  };
  /// Messages of the chunk at hand, with their heads.
  std::vector<Held> held_;
  std::vector<std::byte> heads_;
  UnpackedCount unpacked_;
};

}  // namespace stillmap::maps::mcap
