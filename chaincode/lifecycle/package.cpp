#include "chaincode/lifecycle/lifecycle.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "common/crypto/crypto.hpp"

namespace ledgerline::chaincode_lifecycle {
namespace {

constexpr std::size_t tar_block = 512;

/// A ustar archive (POSIX.1-1988) of files that are everybody's to read, made at time 0.
std::string tar_of(const std::vector<std::pair<std::string, std::string>>& files) {
  std::string out;
  for (const auto& [name, content] : files) {
    std::string header(tar_block, '\0');
    const auto put = [&](std::size_t at, const std::string& text) { header.replace(at, text.size(), text); };
    put(0, name);
    put(100, "0000644");
    put(108, "0000000");
    put(116, "0000000");
    put(124, fmt::format("{:011o}", content.size()));
    put(136, "00000000000");
    put(148, "        ");  // the sum counts its own field as spaces
    put(156, "0");
    put(257, std::string("ustar\0"
                         "00",
                         8));
    unsigned sum = 0;
    for (const char c : header) sum += static_cast<unsigned char>(c);
    put(148, fmt::format("{:06o}", sum) + std::string("\0 ", 2));
    out += header + content;
    out.append((tar_block - content.size() % tar_block) % tar_block, '\0');
  }
  out.append(2 * tar_block, '\0');
  return out;
}

std::uint32_t crc32_of(const std::string& bytes) {
  std::uint32_t crc = 0xffffffff;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xedb88320U : 0U);
  }
  return ~crc;
}

void put_little_endian(std::string& out, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<char>(value >> (8 * i) & 0xff));
}

/// gzip (RFC 1952) whose blocks are stored, not compressed: some kilobytes, and no library's version changes the bytes.
std::string gzip_of(const std::string& bytes) {
  std::string out("\x1f\x8b\x08\0\0\0\0\0\0\xff", 10);
  constexpr std::size_t max_block = 0xffff;
  std::size_t at = 0;
  do {
    const std::size_t size = std::min(max_block, bytes.size() - at);
    out.push_back(at + size == bytes.size() ? 1 : 0);
    put_little_endian(out, size, 2);
    put_little_endian(out, ~size, 2);
    out.append(bytes, at, size);
    at += size;
  } while (at < bytes.size());
  put_little_endian(out, crc32_of(bytes), 4);
  put_little_endian(out, bytes.size(), 4);
  return out;
}

}  // namespace

std::string connection_json(const ServicePlace& place) {
  nlohmann::json out{{"address", place.address},
                     {"dial_timeout", "10s"},
                     {"tls_required", !place.root_pem.empty()},
                     {"client_auth_required", place.client_auth}};
  if (!place.root_pem.empty()) out["root_cert"] = place.root_pem;
  if (!place.client_pem.empty()) out["client_cert"] = place.client_pem;
  if (!place.client_key_pem.empty()) out["client_key"] = place.client_key_pem;
  return out.dump(2);
}

std::string make_package(const std::string& label, const std::string& connection) {
  const std::string code = gzip_of(tar_of({{"connection.json", connection}}));
  const std::string metadata = nlohmann::json{{"type", "ccaas"}, {"label", label}}.dump(1);
  return gzip_of(tar_of({{"metadata.json", metadata}, {"code.tar.gz", code}}));
}

std::string package_id(const std::string& label, const std::string& package) {
  return label + ":" + crypto::hex(crypto::sha256(package));
}

bool is_label(const std::string& text) {
  const auto is_plain = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; };
  return !text.empty() && text.size() <= 100 && is_plain(text[0]) && std::all_of(text.begin(), text.end(), [&](char c) {
    return is_plain(c) || c == '_' || c == '.' || c == '+' || c == '-';
  });
}

}  // namespace ledgerline::chaincode_lifecycle
