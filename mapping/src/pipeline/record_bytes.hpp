#pragma once

#include "core/byte_reader.hpp"

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

/// Records of a journal: `put` appends a value, `get` takes it again in the same order. The same
/// program reads them on a machine of the same instruction set. A file that has types of its own
/// adds its overloads in this namespace.
namespace stillmap::mapping {

template <typename Number>
  requires std::is_arithmetic_v<Number>
void put(std::string& bytes, Number value) {
  put_number(bytes, value);
}
inline void put(std::string& bytes, maps::ObjectClass value) { put_number(bytes, value); }

inline void put(std::string& bytes, std::string_view text) {
  put(bytes, text.size());
  bytes.append(text);
}
inline void put(std::string& bytes, const std::string& text) { put(bytes, std::string_view(text)); }

template <typename Scalar>
void put(std::string& bytes, const Eigen::Matrix<Scalar, 3, 1>& v) {
  for (const Scalar value : v) put(bytes, value);
}

inline void put(std::string& bytes, const Eigen::Isometry3d& T) {
  for (const double value : T.matrix().reshaped()) put(bytes, value);
}

inline void put(std::string& bytes, const std::vector<bool>& flags) {
  put(bytes, flags.size());
  for (std::size_t i = 0; i < flags.size(); i += 8) {
    unsigned packed = 0;
    for (std::size_t k = i; k < std::min(i + 8, flags.size()); ++k)
      packed |= (flags[k] ? 1U : 0U) << (k - i);
    put(bytes, static_cast<std::uint8_t>(packed));
  }
}

void put(std::string& bytes, const maps::Box& box);
void get(ByteReader& reader, maps::Box& box);

template <typename... Fields>
void put_each(std::string& bytes, const Fields&... fields) {
  (put(bytes, fields), ...);
}

/// Taken apart by structured bindings: a field that is added stops this from compiling.
inline void put(std::string& bytes, const maps::Box& box) {
  const auto& [centre, size_m, yaw_rad, object_class, score, track] = box;
  put_each(bytes, centre, size_m, yaw_rad, object_class, score, track);
}

template <typename Key, typename Number>
void put(std::string& bytes, const std::pair<const Key, Number>& entry) {
  put_each(bytes, entry.first, entry.second);
}

template <typename All>
void put_all(std::string& bytes, const All& all) {
  put(bytes, all.size());
  for (const auto& each : all) put(bytes, each);
}

inline void get(ByteReader& reader, bool& value) {
  const auto byte = reader.number<std::uint8_t>();
  if (byte > 1) reader.refuse("a flag that is neither 0 nor 1");
  value = byte == 1;
}
template <typename Number>
  requires std::is_arithmetic_v<Number>
void get(ByteReader& reader, Number& value) {
  value = reader.number<Number>();
}
inline void get(ByteReader& reader, maps::ObjectClass& value) {
  using Number = std::underlying_type_t<maps::ObjectClass>;
  const auto found = reader.number<Number>();
  if (found < 0 || found > static_cast<Number>(maps::ObjectClass::kUnknown))
    reader.refuse("a class that is none");
  value = static_cast<maps::ObjectClass>(found);
}
template <typename Scalar>
void get(ByteReader& reader, Eigen::Matrix<Scalar, 3, 1>& v) {
  for (Scalar& value : v) get(reader, value);
}
inline void get(ByteReader& reader, Eigen::Isometry3d& T) {
  for (double& value : T.matrix().reshaped()) get(reader, value);
}
inline void get(ByteReader& reader, std::string& text) { text = reader.take(reader.count(1)); }
inline void get(ByteReader& reader, std::vector<bool>& flags) {
  const auto size = reader.number<std::size_t>();
  // Not (size + 7) / 8, which may wrap around.
  const std::string_view packed = reader.take(size / 8 + (size % 8 == 0 ? 0 : 1));
  flags.resize(size);
  for (std::size_t i = 0; i < size; ++i)
    flags[i] = (static_cast<unsigned char>(packed[i / 8]) >> (i % 8) & 1U) != 0;
}

template <typename... Fields>
void get_each(ByteReader& reader, Fields&... fields) {
  (get(reader, fields), ...);
}

inline void get(ByteReader& reader, maps::Box& box) {
  auto& [centre, size_m, yaw_rad, object_class, score, track] = box;
  get_each(reader, centre, size_m, yaw_rad, object_class, score, track);
}

/// @param least_bytes  no element takes fewer: a wrong count then fills no memory.
template <typename Each>
void get_all(ByteReader& reader, std::vector<Each>& all, std::size_t least_bytes = 16) {
  all.resize(reader.count(least_bytes));
  for (Each& each : all) get(reader, each);
}
template <typename Key, typename Number>
void get_all(ByteReader& reader, std::map<Key, Number>& all) {
  for (std::size_t left = reader.count(sizeof(Number)); left > 0; --left) {
    Key key{};
    get(reader, key);
    get(reader, all[key]);
  }
}

}  // namespace stillmap::mapping
