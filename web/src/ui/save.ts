/** Has the browser save what an address of this origin brings. */
export function saveAddress(address: string, name: string): void {
  const link = document.createElement('a');
  link.href = address;
  link.download = name;
  link.click();
}

/** Has the browser save bytes as a file. */
export function saveBlob(blob: Blob, name: string): void {
  const address = URL.createObjectURL(blob);
  saveAddress(address, name);
  // After the browser has begun with it.
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
