#pragma once
#include <string>

#include "common/fabric/receipt/receipt_judge.hpp"

namespace ledgerline::receipt {

/// What is proven and by whose word, a line each, for a person. What strangers chose is made printable.
std::string words(const fabric::Proven& proven);

/// The same as one JSON object in one line.
std::string json(const fabric::Proven& proven);

}  // namespace ledgerline::receipt
