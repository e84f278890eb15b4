#pragma once
#include <cstdint>
#include <string>

#include "common/fabric/receipt/receipt_verifier.hpp"

namespace ledgerline::receipt {

/// What is proven and by whose word, a line each, for a person, with what was looked at of the certificates; `now_s`:
/// Unix time, of which it depends which have expired. What others chose is made printable.
std::string words(const fabric::ReceiptProof& proven, std::int64_t now_s);

/// The same as one JSON object in one line.
std::string json(const fabric::ReceiptProof& proven, std::int64_t now_s);

/// Of one receipt among several, one line.
std::string line(const std::string& file, const Result<fabric::ReceiptProof>& proven);
/// The same with all that json() says, as one JSON object.
std::string json_line(const std::string& file, const Result<fabric::ReceiptProof>& proven, std::int64_t now_s);

}  // namespace ledgerline::receipt
