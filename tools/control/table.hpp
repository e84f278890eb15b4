#pragma once
#include <string>
#include <vector>

#include "ledgerline.pb.h"

namespace ledgerline::control {

/// Control records for people: a paragraph for each drone, in the order given. Names are made printable. Pure.
std::string control_table(const std::vector<Control>& controls);

}  // namespace ledgerline::control
