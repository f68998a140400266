// Keeps a copy of the map that a stillmap server serves as FOLDER/current:
//
//   mirror_map http://127.0.0.1:8080 MAP FOLDER
//
// A key, where the server asks for one, stands in the environment: STILLMAP_KEY.

#include "stillmap_mirror.hpp"

#include <cstdlib>
#include <iostream>

int main(int count, char** arguments) {
  if (count != 4) {
    std::cerr << "usage: mirror_map URL MAP FOLDER\n";
    return 2;
  }
  try {
    const char* const key = std::getenv("STILLMAP_KEY");
    stillmap::client::Client client(arguments[1], key == nullptr ? "" : key);
    const auto mirrored = stillmap::client::mirror(client, arguments[2], arguments[3]);
    std::cout << mirrored.map.version << ' ' << mirrored.map.digest << ' ' << mirrored.fetched_bytes
              << " bytes fetched\n";
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "mirror_map: " << error.what() << '\n';
    return 1;
  }
}
