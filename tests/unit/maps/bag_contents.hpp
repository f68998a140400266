#pragma once

#include <string>
#include <vector>

#include "bags/bag.hpp"

namespace stillmap::test {

inline std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// "/topic head" of each message that a visit hands on.
struct Visited {
  std::vector<std::string> heads;
  std::vector<maps::MessagePlace> places;
  maps::BagDamage damage;
};

/// @param bytes  of each message's head. @param topic  one alone, or all.
inline Visited visit(const maps::Bag& bag, std::size_t bytes = 1000,
                     const std::string& topic = "") {
  std::vector<std::size_t> wanted;
  for (const maps::BagTopic& each : bag.topics())
    wanted.push_back(topic.empty() || each.name == topic ? bytes : 0);
  Visited visited;
  visited.damage = bag.visit(wanted, [&](const maps::BagMessage& message) {
    visited.heads.push_back(bag.topics()[message.topic].name + " " + text_of(message.head));
    visited.places.push_back(message.place);
  });
  return visited;
}

/// Every message as `read` gives it, in the order of the visit.
inline std::vector<std::string> contents(const maps::Bag& bag) {
  std::vector<std::string> all;
  for (const maps::MessagePlace& place : visit(bag).places)
    all.push_back(text_of(bag.read(place).span()));
  return all;
}

}  // namespace stillmap::test
