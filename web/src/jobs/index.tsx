import './jobs.css';
import type { ViewProps } from '../state/router.js';
import { JobPage } from './job_page.js';
import { JobsPage } from './jobs_page.js';

/** All jobs, or one job and its progress. */
export default function JobsView({ path: [id], query }: ViewProps) {
  return id === undefined ? <JobsPage query={query} /> : <JobPage key={id} id={Number(id)} />;
}
