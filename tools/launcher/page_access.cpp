#include "tools/launcher/page_access.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <qrencode.h>

#include <filesystem>
#include <memory>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "tools/command/runtime_folder.hpp"

namespace ledgerline::launcher {
namespace {

namespace fs = std::filesystem;

constexpr int certificate_days = 30;  // of one run: no flight is longer

}  // namespace

Result<ListenAddress> listen_address_from(const std::string& text) {
  const Error wrong{printable(text) +
                    " is no address of this computer as other devices reach it, such as 192.168.1.20 "
                    "or 192.168.1.20:8800 (`ip address` lists them)"};
  const auto colon = text.find(':');
  ListenAddress listen{text.substr(0, colon), 0};
  in_addr parsed{};
  if (::inet_pton(AF_INET, listen.address.c_str(), &parsed) != 1 || parsed.s_addr == INADDR_ANY) return wrong;
  if (colon == std::string::npos) return listen;
  if (!check_endpoint(text)) return wrong;
  listen.port = std::stoi(text.substr(colon + 1));
  return listen;
}

Status make_page_certificate(const RunFiles& files, const std::string& address) {
  const auto ca = crypto::make_ca("Ledgerline page of one run", "Ledgerline");
  if (!ca) return ca.error();
  const auto page = crypto::issue(*ca, {.common_name = address,
                                        .organization = "Ledgerline",
                                        .unit = std::nullopt,
                                        .sans = {address, "127.0.0.1", "localhost"},
                                        .tls = true,
                                        .days = certificate_days});
  if (!page) return page.error();
  if (auto s = write_file(files.in("page-ca.pem"), ca->certificate_pem); !s) return s;
  if (auto s = write_file(files.in("page.pem"), page->certificate_pem); !s) return s;
  return write_file(files.in("page.key"), page->key_pem, 0600);
}

Status link_station(const std::string& folder, const std::string& config) {
  if (folder.empty()) return Error{"neither XDG_RUNTIME_DIR nor HOME is set"};
  const fs::path link = fs::path(folder) / flight_link, made = link.string() + ".new";
  std::error_code error;
  if (fs::create_directories(folder, error)) fs::permissions(folder, fs::perms::owner_all, error);
  if (!error) fs::remove(made, error);
  if (!error) fs::create_symlink(config, made, error);
  if (!error) fs::rename(made, link, error);
  return error ? Status(Error{fmt::format("cannot make {}: {}", link.string(), error.message())}) : Status(done);
}

void unlink_station(const std::string& folder, const std::string& config) {
  const fs::path link = fs::path(folder) / flight_link;
  std::error_code error;
  if (fs::read_symlink(link, error) == config) fs::remove(link, error);
}

Result<std::string> fingerprint(const std::string& pem) {
  constexpr std::string_view begin = "-----BEGIN CERTIFICATE-----", end = "-----END CERTIFICATE-----";
  const auto from = pem.find(begin), to = pem.find(end);
  if (from == std::string::npos || to == std::string::npos || to < from) return Error{"no certificate is in it"};
  const auto der = crypto::unbase64(std::string_view(pem).substr(from + begin.size(), to - from - begin.size()));
  if (!der) return Error{"its certificate is damaged"};
  std::string text;
  for (const unsigned char byte : crypto::sha256(*der)) text += fmt::format("{}{:02X}", text.empty() ? "" : ":", byte);
  return text;
}

Result<std::string> qr_code(const std::string& text) {
  const std::unique_ptr<QRcode, decltype(&QRcode_free)> code(QRcode_encodeString8bit(text.c_str(), 0, QR_ECLEVEL_L),
                                                             QRcode_free);
  if (!code) return Error{fmt::format("{} characters do not fit into a QR code", text.size())};
  constexpr int quiet = 2;  // modules around it; readers on a screen need less than the norm's four
  const auto is_dark = [&](int x, int y) {
    const bool inside = x >= 0 && y >= 0 && x < code->width && y < code->width;
    return inside && (code->data[y * code->width + x] & 1) != 0;
  };
  std::string lines;
  for (int y = -quiet; y < code->width + quiet; y += 2) {
    lines += "\033[30;107m";  // black on white, whatever the terminal has
    for (int x = -quiet; x < code->width + quiet; ++x) {
      const bool upper = is_dark(x, y), lower = is_dark(x, y + 1);
      lines += upper && lower ? "█" : upper ? "▀" : lower ? "▄" : " ";
    }
    lines += "\033[0m\n";
  }
  return lines;
}

}  // namespace ledgerline::launcher
