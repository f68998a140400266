#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "formats/file_bytes.hpp"

namespace stillmap::maps {

/// How messages are written.
enum class Serialization : std::uint8_t { kCdr, kRos1, kOther };

/// No message beyond is read: 2.7 million points of 48 bytes.
inline constexpr std::size_t kMostMessageBytes = std::size_t{128} << 20U;

struct BagTopic {
  std::string name;
  /// As ROS 2 writes it, also for ROS 1: "sensor_msgs/msg/PointCloud2".
  std::string type;
  Serialization serialization = Serialization::kOther;
};

/// Where a message lies in its bag; what the numbers mean is the bag's own.
struct MessagePlace {
  std::uint64_t outer = 0;
  std::uint64_t inner = 0;
  /// Of the message [bytes].
  std::uint32_t size = 0;
};

struct BagMessage {
  /// In `Bag::topics`.
  std::size_t topic = 0;
  MessagePlace place;
  /// When the recorder got it [ns since the epoch].
  std::int64_t recorded_ns = 0;
  /// Its first bytes, as many as were asked for; valid during the call.
  std::span<const std::byte> head;
};

/// What of a bag could not be read.
struct BagDamage {
  /// Chunks, records or rows.
  std::size_t parts = 0;
  /// What the first of them is.
  std::string first;

  void add(const std::string& what) {
    if (parts++ == 0) first = what;
  }
};

/// What a file is.
enum class BagFormat : std::uint8_t { kMcap, kSqlite, kRos1, kPcap };

/// A file of messages. Memory does not grow with the file. Safe from several threads.
class Bag {
 public:
  Bag() = default;
  virtual ~Bag() = default;
  Bag(const Bag&) = delete;
  Bag& operator=(const Bag&) = delete;

  [[nodiscard]] virtual const std::filesystem::path& file() const = 0;
  [[nodiscard]] virtual BagFormat format() const = 0;
  [[nodiscard]] virtual const std::vector<BagTopic>& topics() const = 0;
  /// What was found when it was opened, for people.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  void add_note(std::string note) { notes_.push_back(std::move(note)); }

  using Take = std::function<void(const BagMessage&)>;
  /// Hands on the messages of some topics in the order of the file, as far as it can be read.
  /// @param head_bytes  one a topic: how many of a message's first bytes are wanted; 0 = none of
  /// its messages.
  /// @return what could not be read. @throws StorageError, and what `take` throws.
  virtual BagDamage visit(std::span<const std::size_t> head_bytes, const Take& take) const = 0;

  /// A whole message. @param place  of a visited one.
  /// @throws InputError when its checksum does not fit or it is not there any more; StorageError.
  [[nodiscard]] virtual FileBytes read(const MessagePlace& place) const = 0;

 private:
  std::vector<std::string> notes_;
};

/// What a file starts with. @return nothing for one of another kind, or none at all.
[[nodiscard]] std::optional<BagFormat> bag_format(const std::filesystem::path& file);

/// One that is packed as a whole is unpacked first (`unpacked_bag.hpp`), and a note says so.
/// @throws InputError for another kind of file or one that is broken from the start; StorageError.
[[nodiscard]] std::unique_ptr<Bag> open_bag(const std::filesystem::path& file);

/// "sensor_msgs/PointCloud2" -> "sensor_msgs/msg/PointCloud2"; others as they are.
[[nodiscard]] std::string ros2_type(const std::string& type);

}  // namespace stillmap::maps
