#pragma once
#include <string>

#include "common/base/result.hpp"
#include "tools/launcher/configs.hpp"

/// The page for browsers on other devices (--listen).
namespace ledgerline::launcher {

/// "192.168.1.20" or "192.168.1.20:8800"; port 0: any. An error: that is no IPv4 address of one host.
struct ListenAddress {
  std::string address;
  int port = 0;
};
Result<ListenAddress> listen_address_from(const std::string& text);

/// Makes an authority, whose key is not kept, and a certificate of this address: page-ca.pem, page.pem, page.key
/// (0600).
Status make_page_certificate(const RunFiles& files, const std::string& address);
/// From now on `ledgerline drones` and its like find the station of this ground's config by themselves: a link to
/// it in that folder (runtime_folder), in the place of one that an earlier flight left.
Status link_station(const std::string& folder, const std::string& config);
/// Removes the link, unless another flight's stands there.
void unlink_station(const std::string& folder, const std::string& config);

/// As browsers show it: "AB:CD:...", SHA-256 of the first certificate in a PEM text. An error: there is none.
Result<std::string> fingerprint(const std::string& pem);

/// A QR code for a terminal, two modules a character, with its quiet zone and its own colours. An error: `text` is too
/// long for one.
Result<std::string> qr_code(const std::string& text);

}  // namespace ledgerline::launcher
