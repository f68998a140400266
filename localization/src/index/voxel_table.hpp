#pragma once

#include <stillmap/maps/cell_table.hpp>

namespace stillmap::localization {

using maps::cell_key;
using maps::cell_of_key;
using maps::is_cell;
using maps::kCellsPerAxis;
using VoxelTable = maps::CellTable;

}  // namespace stillmap::localization
