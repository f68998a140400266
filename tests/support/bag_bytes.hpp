#pragma once

#include <bzlib.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zlib.h>
#include <zstd.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "support/message_bytes.hpp"

/// Bags, written out by hand so that tests do not depend on a writer of ours.
namespace stillmap::test {

/// lz4 frames, zstd, bz2, or as it is.
[[nodiscard]] inline std::string packed(std::string_view text, std::string_view compression) {
  if (compression.empty() || compression == "none") return std::string(text);
  if (compression == "bz2") {
    std::string from(text);
    auto size = static_cast<unsigned>(text.size() + text.size() / 50 + 700);
    std::string out(size, '\0');
    BZ2_bzBuffToBuffCompress(out.data(), &size, from.data(), static_cast<unsigned>(from.size()), 9,
                             0, 0);
    out.resize(size);
    return out;
  }
  const bool lz4 = compression == "lz4";
  std::string out(
      lz4 ? LZ4F_compressFrameBound(text.size(), nullptr) : ZSTD_compressBound(text.size()), '\0');
  out.resize(lz4 ? LZ4F_compressFrame(out.data(), out.size(), text.data(), text.size(), nullptr)
                 : ZSTD_compress(out.data(), out.size(), text.data(), text.size(), 3));
  return out;
}

/// ROS 1, format 2.0, record by record.
class Ros1Bytes {
 public:
  template <typename Number>
  static std::string number(Number value) {
    std::string bytes(sizeof(Number), '\0');
    std::memcpy(bytes.data(), &value, sizeof(Number));
    return bytes;
  }
  static std::string sized(std::string_view bytes) {
    return number(static_cast<std::uint32_t>(bytes.size())) + std::string(bytes);
  }
  static std::string field(std::string_view name, std::string_view value) {
    return sized(std::string(name) + "=" + std::string(value));
  }
  static std::string record(std::uint8_t op, std::string_view fields, std::string_view data) {
    return sized(field("op", number(op)) + std::string(fields)) + sized(data);
  }
  static std::string connection(std::uint32_t id, std::string_view topic, std::string_view type) {
    return record(7, field("conn", number(id)) + field("topic", topic),
                  field("topic", topic) + field("type", type) + field("md5sum", "*") +
                      field("message_definition", "string data"));
  }
  static std::string message(std::uint32_t connection, std::string_view data) {
    return record(2, field("conn", number(connection)) + field("time", number(std::uint64_t{9})),
                  data);
  }
  static std::string chunk_head(std::string_view compression, std::uint32_t unpacked_bytes,
                                std::uint32_t packed_bytes) {
    return sized(field("op", number(std::uint8_t{5})) + field("compression", compression) +
                 field("size", number(unpacked_bytes))) +
           number(packed_bytes);
  }

  Ros1Bytes& add(std::string_view bytes) {
    bytes_ += bytes;
    return *this;
  }
  /// @param connections  with messages in it, for the index.
  Ros1Bytes& add_chunk(std::string_view records, std::string_view compression,
                       const std::set<std::uint32_t>& connections) {
    const std::string bytes = packed(records, compression);
    std::string counts;
    for (const std::uint32_t id : connections) counts += number(id) + number(std::uint32_t{1});
    infos_ += record(6,
                     field("ver", number(std::uint32_t{1})) +
                         field("chunk_pos", number(std::uint64_t{kStart + bytes_.size()})) +
                         field("count", number(static_cast<std::uint32_t>(connections.size()))),
                     counts);
    ++chunks_;
    bytes_ += chunk_head(compression, static_cast<std::uint32_t>(records.size()),
                         static_cast<std::uint32_t>(bytes.size())) +
              bytes;
    bytes_ += record(4, field("ver", number(std::uint32_t{1})), "12345678");
    return *this;
  }
  /// @param connections  of the index; empty = none, as of a recording that was cut off.
  [[nodiscard]] std::string finished(std::string_view connections, std::uint32_t count) const {
    const std::uint64_t index = connections.empty() ? 0 : kStart + bytes_.size();
    std::string header =
        sized(field("op", number(std::uint8_t{3})) + field("index_pos", number(index)) +
              field("conn_count", number(count)) + field("chunk_count", number(chunks_)));
    header += sized(std::string(kStart - 13 - header.size() - 4, ' '));
    std::string bag = "#ROSBAG V2.0\n" + header + bytes_;
    if (index > 0) bag += std::string(connections) + infos_;
    return bag;
  }

 private:
  /// The header is padded, so that it can be written again.
  static constexpr std::size_t kStart = 4096 + 13;
  std::string bytes_;
  std::string infos_;
  std::uint32_t chunks_ = 0;
};

/// MCAP, record by record.
class McapBytes {
 public:
  template <typename Number>
  static std::string number(Number value) {
    std::string bytes(sizeof(Number), '\0');
    std::memcpy(bytes.data(), &value, sizeof(Number));
    return bytes;
  }
  static std::string text(std::string_view letters) {
    return number(static_cast<std::uint32_t>(letters.size())) + std::string(letters);
  }
  static std::string record(std::uint8_t op, std::string_view content) {
    return static_cast<char>(op) + number(std::uint64_t{content.size()}) + std::string(content);
  }
  static std::string schema(std::uint16_t id, std::string_view name) {
    return record(3, number(id) + text(name) + text("ros2msg") + text("float64 x"));
  }
  static std::string channel(std::uint16_t id, std::uint16_t schema, std::string_view topic,
                             std::string_view encoding = "cdr") {
    return record(4, number(id) + number(schema) + text(topic) + text(encoding) + text(""));
  }
  static std::string message(std::uint16_t channel, std::string_view data,
                             std::uint64_t recorded_ns = 9) {
    return record(5, number(channel) + number(std::uint32_t{0}) + number(recorded_ns) +
                         number(std::uint64_t{9}) + std::string(data));
  }
  static std::uint32_t crc(std::string_view bytes) {
    return static_cast<std::uint32_t>(
        ::crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
  }
  static std::string chunk(std::string_view records, std::string_view compression) {
    const std::string bytes = packed(records, compression);
    return record(6, number(std::uint64_t{1}) + number(std::uint64_t{2}) +
                         number(std::uint64_t{records.size()}) + number(crc(records)) +
                         text(compression) + number(std::uint64_t{bytes.size()}) + bytes);
  }

  /// To the data, as it is.
  McapBytes& add(std::string_view bytes) {
    bytes_ += bytes;
    return *this;
  }
  /// @param channels  with messages in it, for the index.
  McapBytes& add_chunk(std::string_view records, std::string_view compression,
                       const std::set<std::uint16_t>& channels) {
    const std::string bytes = chunk(records, compression);
    std::string offsets;
    for (const std::uint16_t id : channels) offsets += number(id) + number(std::uint64_t{0});
    index_ +=
        record(8, number(std::uint64_t{1}) + number(std::uint64_t{2}) +
                      number(std::uint64_t{bytes_.size()}) + number(std::uint64_t{bytes.size()}) +
                      text(offsets) + number(std::uint64_t{0}) + text(compression) +
                      number(std::uint64_t{0}) + number(std::uint64_t{records.size()}));
    return add(bytes);
  }
  /// The data alone, as of a recorder that was killed.
  [[nodiscard]] const std::string& data() const { return bytes_; }
  /// With a summary of these records and the chunks' index, or without any.
  [[nodiscard]] std::string finished(std::string_view summary = {}) const {
    std::string all = bytes_ + record(15, number(std::uint32_t{0}));
    const std::uint64_t start = all.size();
    const std::string rest = summary.empty() ? "" : std::string(summary) + index_;
    std::string footer = static_cast<char>(2) + number(std::uint64_t{20}) +
                         number(summary.empty() ? std::uint64_t{0} : start) +
                         number(std::uint64_t{0});
    footer += number(summary.empty() ? std::uint32_t{0} : crc(rest + footer));
    return all + rest + footer + kMagic;
  }

 private:
  inline static const std::string kMagic{"\x89MCAP0\r\n", 8};
  std::string bytes_ = kMagic + record(1, text("ros2") + text("test"));
  std::string index_;
};

/// SQLite by its own library.
class SqliteFile {
 public:
  explicit SqliteFile(const std::filesystem::path& file) {
    if (sqlite3_open(file.c_str(), &connection_) != SQLITE_OK)
      throw std::runtime_error("cannot make " + file.string());
  }
  ~SqliteFile() { sqlite3_close(connection_); }
  SqliteFile(const SqliteFile&) = delete;
  SqliteFile& operator=(const SqliteFile&) = delete;

  SqliteFile& run(const std::string& sql) {
    char* reason = nullptr;
    if (sqlite3_exec(connection_, sql.c_str(), nullptr, nullptr, &reason) != SQLITE_OK)
      throw std::runtime_error(sql + ": " + reason);
    return *this;
  }
  SqliteFile& message(int topic, std::string_view data) {
    sqlite3_stmt* insert = nullptr;
    sqlite3_prepare_v2(connection_,
                       "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, 9, ?)", -1,
                       &insert, nullptr);
    sqlite3_bind_int(insert, 1, topic);
    sqlite3_bind_blob(insert, 2, data.data(), static_cast<int>(data.size()), SQLITE_TRANSIENT);
    const int code = sqlite3_step(insert);
    sqlite3_finalize(insert);
    if (code != SQLITE_DONE) throw std::runtime_error("cannot insert");
    return *this;
  }
  SqliteFile& topic(int id, const std::string& name, const std::string& type) {
    return run("INSERT INTO topics (id, name, type, serialization_format" +
               std::string(schema_ > 1 ? ", offered_qos_profiles" : "") +
               (schema_ > 3 ? ", type_description_hash" : "") + ") VALUES (" + std::to_string(id) +
               ", '" + name + "', '" + type + "', 'cdr'" + (schema_ > 1 ? ", ''" : "") +
               (schema_ > 3 ? ", 'RIHS01_0'" : "") + ")");
  }
  /// The tables of rosbag2's schema 1 to 4.
  SqliteFile& make_tables(int schema = 4) {
    schema_ = schema;
    run("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL" +
        std::string(schema > 1 ? ", offered_qos_profiles TEXT NOT NULL" : "") +
        (schema > 3 ? ", type_description_hash TEXT NOT NULL" : "") + ")");
    run("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp "
        "INTEGER NOT NULL, data BLOB NOT NULL)");
    run("CREATE INDEX timestamp_idx ON messages (timestamp ASC)");
    if (schema > 2) {
      run("CREATE TABLE schema (schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)");
      run("INSERT INTO schema VALUES (" + std::to_string(schema) + ", 'jazzy')");
      run("CREATE TABLE metadata (id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, "
          "metadata TEXT NOT NULL)");
    }
    if (schema > 3)
      run("CREATE TABLE message_definitions (id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, "
          "encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, "
          "type_description_hash TEXT NOT NULL)");
    return *this;
  }

 private:
  sqlite3* connection_ = nullptr;
  int schema_ = 4;
};

/// A bag of MCAP with one cloud on each topic. @param stamp_ns  of the first; each next is later.
[[nodiscard]] inline std::string bag_of_clouds(const std::vector<std::string>& topics,
                                               std::int64_t stamp_ns = 1) {
  McapBytes bag;
  bag.add(McapBytes::schema(1, "sensor_msgs/msg/PointCloud2"));
  std::uint16_t id = 0;
  for (const std::string& topic : topics) {
    ++id;
    bag.add(McapBytes::channel(id, 1, topic) + McapBytes::message(id, one_point(stamp_ns++, 1.0F)));
  }
  return bag.finished();
}

/// On /cloud1 and /cloud2.
[[nodiscard]] inline std::string bag_of_two_clouds() {
  return bag_of_clouds({"/cloud1", "/cloud2"});
}

}  // namespace stillmap::test
